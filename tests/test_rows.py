"""Rows of what is left out: verdicts by the spread, and words for what changes."""

import time
from functools import partial

import numpy as np
import pytest

from deformrf.core.lab.omissions import rows as omitted
from deformrf.core.lab.report.parts import record
from deformrf.core.lab.stopwatch import Timing, compared, in_turns, timing_of


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
