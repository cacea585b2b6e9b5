"""One row of what is left out: verdicts by the spread, words for what changes, failures."""

import subprocess

import numpy as np
import pytest

from deformrf.wings.lab.omissions import switch as omitted
from deformrf.wings.lab.omissions.switch import Switch, measured
from deformrf.wings.lab.report.contents import record
from deformrf.wings.lab.stopwatch import in_turns


def switch(measure):
    return Switch("a thing", omitted.FILE, "MB", "It is idle.", measure)


def failing(error):
    def fail():
        raise error

    return switch(fail)


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(28, "No space left on device", "/tmp/a b/model.npz"), "'model.npz'."),
        (RuntimeError("first\nCan't read C:\\me\\x.npz in m/s."), "Can't read x.npz in m/s."),
        (subprocess.TimeoutExpired("/bin/x", 3.0), "'x' timed out after 3.0 seconds."),
        (RuntimeError(), "RuntimeError."),
    ],
)
def test_a_failure_is_said_in_a_line_without_folders(error, reason):
    row = measured(failing(error))
    assert row.verdict == omitted.NOT_MEASURED and row.saving is None
    assert row.why.startswith("Measuring it failed: ") and row.why.endswith(reason)
    assert "\n" not in row.why and "/tmp" not in row.why


def test_a_mistake_of_the_program_is_no_failure_of_the_machine():
    with pytest.raises(ZeroDivisionError):
        measured(switch(lambda: 1 // 0))


@pytest.mark.parametrize(
    ("with_it", "without", "found"),
    [
        ([9.0, 10.0, 11.0], [8.0, 8.0, 8.0], omitted.SAVES),
        ([7.0, 6.0, 5.0], [8.0, 8.0, 8.0], omitted.COSTS),
        ([7.0, 10.0, 11.0], [8.0, 8.0, 8.0], omitted.NOTHING),  # across zero
        ([8.0], [8.0], omitted.NOTHING),
        ([3.0], [2.0], omitted.SAVES),
        ([2.0, 4.0], [1.0, 3.0], omitted.NOTHING),  # the sign alone: by chance in 1 of 2 cases
        ([1.0, 3.0], [2.0, 4.0], omitted.NOTHING),
        ([2.0, 2.2], [1.0, 1.9], omitted.SAVES),
        ([1.0, 1.9, 1.5], [2.0, 2.2, 2.1], omitted.COSTS),
        ([2.0, 4.0, 6.0, 8.0], [1.0, 3.0, 5.0, 7.0], omitted.NOTHING),
        ([2.0, 4.0, 6.0, 8.0, 10.0], [1.0, 3.0, 5.0, 7.0, 9.0], omitted.SAVES),
    ],
)
def test_a_saving_counts_if_its_spread_is_on_one_side_and_few_turns_do_not_overlap(
    with_it, without, found
):
    row = measured(switch(lambda: (in_turns(with_it, without), "")))
    assert (row.verdict, row.why) == (found, "It is idle.")


def test_a_saving_is_a_share_of_what_it_is_with():
    row = measured(switch(lambda: (in_turns([4.0, 5.0, 6.0], [3.0, 3.0, 3.0]), "")))
    assert row.percent.median == pytest.approx(40.0)
    assert (row.saving.median, row.saving.count) == (2.0, 3)


def test_records_have_the_same_columns_measured_or_not():
    one = record(measured(switch(lambda: (in_turns([3.0], [2.0]), ""))))
    other = record(measured(failing(OSError("no way"))))
    assert list(one) == list(other)
    assert (one["saving"], one["saving_low"], one["saving_repeats"]) == (1.0, 1.0, 1)
    assert other["saving"] is None and other["verdict"] == omitted.NOT_MEASURED


def test_what_images_differ_by():
    images = [np.full((4, 4, 4), 100, np.uint8)] * 2
    assert omitted.image_change(images, images) == omitted.NONE
    off = images[0].copy()
    off[..., :3] += 51
    assert omitted.image_change(images[:1], [off]) == "14.0 dB, at most 51/255"


def test_what_poses_differ_by():
    pose = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
    assert omitted.pose_change(pose, pose.copy(), 2.0) == omitted.NONE
    moved = pose.astype(float)
    moved[3] += [0.0, 0.3, 0.4]
    assert omitted.pose_change(pose, moved, 2.0) == "at most 0.25 sizes"
