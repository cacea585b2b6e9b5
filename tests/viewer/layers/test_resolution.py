"""Resolution follows the frame time, settles, and refining covers every row once."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.viewer.layers.resolution import (
    CPU_LADDER,
    FACTORS,
    FITS,
    HALF,
    LADDER,
    LATE,
    SMALL,
    SMALL_STRIDES,
    STRIDES,
    STRIP_SECONDS,
    TOO_SLOW,
    MovingResolution,
    Picture,
    Rung,
    finer,
)

EDGES = 0.1 / 2.0 ** np.arange(6)  # of six levels


def settle(seconds_at_full, target=0.04, ladder=LADDER, frames=60, fixed=0.0):
    """The rungs chosen for an image that takes that long in full, and `fixed` however it is."""
    moving = MovingResolution(target, ladder)
    rungs = []
    for _ in range(frames):
        rungs.append(moving.rung)
        moving.measured(seconds_at_full * moving.rung.cost + fixed)
    return rungs


def test_each_step_halves_the_pixels():
    assert [round(a * a / b / b, 9) for a, b in pairwise(FACTORS)] == [2] * 6
    assert min(FACTORS) == pytest.approx(0.125)


@pytest.mark.parametrize("ladder", [LADDER, CPU_LADDER])
def test_a_fast_renderer_gets_all_pixels_in_full_quality(ladder):
    assert settle(0.01, ladder=ladder)[-1] == ladder[0]
    assert (ladder[0].factor, ladder[0].step_factor, ladder[0].spared_levels) == (1.0, 1.0, 0)


@pytest.mark.parametrize("ladder", [LADDER, CPU_LADDER])
@pytest.mark.parametrize("seconds", [0.05, 0.1, 0.3, 0.45, 0.9, 1.7])
def test_a_slow_renderer_meets_the_target_and_then_keeps_its_rung(seconds, ladder):
    rungs = settle(seconds, ladder=ladder)
    assert len(set(rungs[30:])) == 1
    assert seconds * rungs[-1].cost <= LATE * 0.04


def test_each_rung_is_cheaper_than_the_one_before():
    for ladder in (LADDER, CPU_LADDER):
        assert all(a.cost > b.cost for a, b in pairwise(ladder))
        assert all(a.factor >= b.factor for a, b in pairwise(ladder))
    assert [rung.stride for rung in CPU_LADDER if rung.scale == SMALL] == list(SMALL_STRIDES)


def test_on_a_cpu_quality_is_given_up_before_there_are_fewer_rays():
    for rung in CPU_LADDER[1:]:
        plain = rung.step_factor == 1.0 and rung.spared_levels == 0
        assert rung.stride in (HALF, STRIDES[0]) or rung.step_factor == 2.0
        assert not plain or rung.stride in (HALF, STRIDES[0])
        rays = rung.scale**2 / (rung.stride[0] * rung.stride[1])
        assert rung.factor == pytest.approx(rays**0.5)
    assert all(rung.step_factor == 1.0 and rung.spared_levels == 0 for rung in LADDER)
    assert all(rung.stride is None for rung in LADDER)


@pytest.mark.parametrize("fixed", [0.005, 0.015, 0.025])
def test_what_all_rungs_take_does_not_keep_it_from_a_better_one(fixed):
    """It ends at the best one that meets the target with time to spare, or at a better one."""
    rungs = settle(0.08, ladder=CPU_LADDER, fixed=fixed, frames=200)
    seconds = {rung: 0.08 * rung.cost + fixed for rung in CPU_LADDER}
    (last,) = set(rungs[60:])
    assert seconds[last] <= LATE * 0.04
    assert seconds[last] >= max(s for s in seconds.values() if s <= FITS * 0.04)


def test_one_slow_frame_changes_nothing():
    moving = MovingResolution(0.1, CPU_LADDER)
    for k in range(60):
        moving.measured(0.4 if k == 40 else 0.7 * moving.rung.cost)
        if k >= 40:
            assert moving.rung.stride == (3, 3)


def test_two_very_slow_frames_are_enough_to_go_down():
    moving = MovingResolution(0.04, LADDER, 0)
    moving.measured(1.0)
    assert moving.step == 0
    moving.measured(1.0)
    assert moving.rung.cost * 1.0 <= TOO_SLOW * 0.04


def test_frames_that_are_a_little_late_lead_down_if_they_go_on():
    moving = MovingResolution(0.04, LADDER, 2)
    for seconds in (0.044, 0.044, 0.04, 0.044, 0.044):
        moving.measured(seconds)
    assert moving.step == 2
    moving.measured(0.044)
    assert moving.step == 3


def test_noise_does_not_make_it_flicker():
    moving = MovingResolution(0.04, LADDER, 2)
    for k in range(100):
        moving.measured(0.03 * (1.3 if k % 2 else 0.7))
    assert moving.step == 2


@pytest.mark.parametrize(
    "pixel, spared, levels",
    [
        (0.001, 2, 6),  # every edge is longer than a pixel
        (0.004, 2, 5),  # the finest is 0.1 / 2^5 = 0.003
        (0.007, 2, 4),
        (0.007, 1, 5),
        (0.007, 0, 6),
        (9.0, 2, 4),
        (9.0, 9, 1),
    ],
)
def test_only_levels_finer_than_a_pixel_are_spared(pixel, spared, levels):
    rung = Rung(1.0, spared_levels=spared)
    assert rung.savings(EDGES, pixel).get("level_count", len(EDGES)) == levels


def test_a_rung_saves_on_what_it_names_and_on_nothing_else():
    assert CPU_LADDER[0].savings(EDGES, 9.0) == {}
    assert CPU_LADDER[-1].savings(EDGES, 9.0) == {"step_factor": 2.0, "level_count": 5}
    assert CPU_LADDER[-1].savings(EDGES, 0.001) == {"step_factor": 2.0}


def test_what_else_takes_time_is_taken_from_rendering_but_not_all_of_it():
    moving = MovingResolution(1.0)
    for other_seconds, target_seconds in ((0.0, 0.1), (0.03, 0.07), (0.5, 0.04)):
        moving.aim(10, other_seconds)
        assert moving.target_seconds == pytest.approx(target_seconds)


def image(row_count):
    return SimpleNamespace(color=np.zeros((row_count, 8)))


def test_strips_cover_every_row_once():
    picture = Picture(100)
    rows = []
    while not picture.done:
        first, last = picture.strip()
        rows += range(first, last)
        picture.add(image(last - first), seconds=0.05 * STRIP_SECONDS * (last - first))
    assert rows == list(range(100))
    assert len(picture.images) > 4


def test_strips_keep_to_their_budget():
    picture = Picture(1000)
    first, last = picture.strip()
    picture.add(image(last - first), 0.2 * STRIP_SECONDS)
    seconds_per_row = 0.2 * STRIP_SECONDS / (last - first)
    first, last = picture.strip()
    assert (last - first) * seconds_per_row == pytest.approx(STRIP_SECONDS)


@pytest.mark.parametrize("factor", FACTORS[1:])
def test_refining_doubles_the_resolution_up_to_the_full_one(factor):
    assert factor < finer(factor) <= 1
    assert finer(factor) == 1.0 or finer(factor) == 2.0 * factor
    assert finer(finer(finer(factor))) == 1.0
