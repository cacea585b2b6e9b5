"""Rows of what is left out: verdicts by the spread, words for what changes, all parts."""

import subprocess
import tempfile
import time
from functools import partial

import numpy as np
import pytest

from deformrf.wings.lab.effort import EFFORTS
from deformrf.wings.lab.omissions import measure as omitted
from deformrf.wings.lab.omissions.measure import FILE, NOT_MEASURED, START, UNITS, Part
from deformrf.wings.lab.omissions.tell import parts
from deformrf.wings.lab.report.parts import record
from deformrf.wings.lab.stopwatch import Timing, compared, in_turns, timing_of

BRIEF = EFFORTS[True, True]._replace(
    frame_size=16, view_count=1, frame_turns=3, step_turns=3, start_turns=1
)
FAILED = "Measuring it failed: "


def test_parts_have_titles_and_take_time(ball, tmp_path, device):
    planned = parts(ball, tmp_path / "no such file.npz", device, BRIEF)
    assert all(part.title and part.seconds > 0.0 for part in planned)
    assert len({part.title for part in planned}) == len(planned)


def test_together_they_are_all_rows(ball, ball_file, device):
    planned = parts(ball, ball_file, device, BRIEF)[:-1]  # compiling takes seconds
    rows = [row for part in planned for row in part.run()]
    assert {row.group for row in rows} == set(UNITS)
    assert len({(row.name, row.unit) for row in rows}) == len(rows) > 15
    for row in rows:
        assert row.why.endswith(".") and row.unit in ("ms", "MB", "s")
        assert (row.saving is None) == (row.verdict == NOT_MEASURED)
        assert FAILED not in row.why


def test_what_fails_is_a_row_and_the_others_are_measured(ball, ball_file, tmp_path, monkeypatch):
    planned = {part.title: part for part in parts(ball, tmp_path / "none.npz", "cpu", BRIEF)}
    (no_start,) = planned["starts with what others import"].run()
    (no_file,) = planned["the model file"].run()
    assert (no_start.group, no_start.unit) == (START, "s")
    assert (no_file.group, no_file.unit) == (FILE, "MB")
    for row in (no_start, no_file):
        assert row.verdict == NOT_MEASURED and row.left_out is None
        assert row.why.startswith(FAILED) and "none.npz" in row.why
        assert str(tmp_path) not in row.why and "Traceback" not in row.why
    planned = {part.title: part for part in parts(ball, ball_file, "cpu", BRIEF)}
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "no such folder"))
    (full,) = planned["kernels of another device"].run()
    assert full.why.startswith(FAILED) and str(tmp_path) not in full.why
    (drag,) = planned["dynamics: gravity and a ground"].run()
    assert drag.verdict != NOT_MEASURED


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
    def fail():
        raise error

    (row,) = Part("a thing", FILE, 1.0, fail).run()
    assert row.why.startswith(FAILED) and row.why.endswith(reason)
    assert "\n" not in row.why and "/tmp" not in row.why


def test_a_mistake_of_the_program_is_no_failure_of_the_machine():
    with pytest.raises(ZeroDivisionError):
        Part("a thing", FILE, 1.0, lambda: 1 // 0).run()


def test_a_quick_look_is_smaller():
    for on_cpu in (True, False):
        quick, full = EFFORTS[on_cpu, True], EFFORTS[on_cpu, False]
        assert quick.frame_size < full.frame_size and quick.start_turns < full.start_turns
        assert quick.compilations == 1 and full.compilations > 2
        assert all(few <= many for few, many in zip(quick, full, strict=True))


def saving(*values):
    return timing_of(values)


@pytest.mark.parametrize(
    ("differences", "found"),
    [
        ((1.0, 2.0, 3.0), omitted.SAVES),
        ((-1.0, -2.0, -3.0), omitted.COSTS),
        ((-1.0, 2.0, 3.0), omitted.NOTHING),
        ((0.0,), omitted.NOTHING),
        ((0.5,), omitted.SAVES),
    ],
)
def test_a_spread_across_zero_is_nothing_measurable(differences, found):
    without = np.full(len(differences), 8.0)
    times = in_turns(without + differences, without)
    assert omitted.verdict(*times) == found
    row = omitted.omission("a thing", omitted.FILE, times, "", "it is idle")
    assert (row.verdict, row.why) == (found, "it is idle")


@pytest.mark.parametrize(
    ("with_it", "without", "found"),
    [
        ([2.0, 4.0], [1.0, 3.0], omitted.NOTHING),  # the sign alone: by chance in 1 of 2 cases
        ([1.0, 3.0], [2.0, 4.0], omitted.NOTHING),
        ([2.0, 2.2], [1.0, 1.9], omitted.SAVES),
        ([1.0, 1.9, 1.5], [2.0, 2.2, 2.1], omitted.COSTS),
        ([2.0, 4.0, 6.0, 8.0], [1.0, 3.0, 5.0, 7.0], omitted.NOTHING),
        ([2.0, 4.0, 6.0, 8.0, 10.0], [1.0, 3.0, 5.0, 7.0, 9.0], omitted.SAVES),
        ([3.0], [2.0], omitted.SAVES),
    ],
)
def test_after_few_turns_the_ways_must_not_overlap(with_it, without, found):
    assert omitted.verdict(*in_turns(with_it, without)) == found


def test_the_same_action_twice_saves_nothing_measurable():
    action = partial(time.sleep, 1e-3)
    times = compared(action, lambda: action(), "cpu", repeats=40)
    assert omitted.verdict(*times) == omitted.NOTHING


def test_a_saving_is_a_part_of_what_it_is_with():
    times = in_turns([4.0, 5.0, 6.0], [3.0, 3.0, 3.0])
    row = omitted.omission("a thing", omitted.START, times, "", "", unit="s")
    assert row.percent.median == pytest.approx(40.0)
    assert times[2] == saving(1.0, 2.0, 3.0)
    assert in_turns([3.0], [2.0])[2] == Timing(1.0, 1.0, 1.0, 1)


def test_records_have_the_same_columns_measured_or_not():
    times = in_turns([3.0], [2.0])
    measured = omitted.omission("a thing", omitted.FILE, times, "", "", unit="MB")
    blank = omitted.not_measured("another", omitted.FILE, "no way", unit="MB")
    one, other = record(measured), record(blank)
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
    pose = np.random.default_rng().normal(size=(5, 3)).astype(np.float32)
    assert omitted.pose_change(pose, pose.copy(), 2.0) == omitted.NONE
    moved = pose.astype(float)
    moved[3] += [0.0, 0.3, 0.4]
    assert omitted.pose_change(pose, moved, 2.0) == "at most 0.25 sizes"
