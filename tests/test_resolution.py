"""Resolution follows the frame time, settles, and refining covers every row once."""

from itertools import pairwise

import pytest

from deformrf.viewer.resolution import FACTORS, MovingResolution, Strips, finer, size_at


def settle(seconds_at_full, target=0.04, start=3, frames=60):
    """The factors chosen for an image that takes that long at full resolution."""
    moving = MovingResolution(target, start)
    factors = []
    for _ in range(frames):
        factors.append(moving.factor)
        moving.measured(seconds_at_full * moving.factor**2)
    return factors


def test_each_step_halves_the_pixels():
    assert [round(a * a / b / b, 9) for a, b in pairwise(FACTORS)] == [2] * 6
    assert min(FACTORS) == pytest.approx(0.125)


def test_a_fast_renderer_gets_all_pixels():
    assert settle(0.01)[-1] == 1.0


@pytest.mark.parametrize("seconds", [0.05, 0.1, 0.3, 0.9, 2.0])
def test_a_slow_renderer_meets_the_target_and_then_keeps_its_factor(seconds):
    factors = settle(seconds)
    assert len(set(factors[20:])) == 1
    assert seconds * factors[-1] ** 2 <= 1.25 * 0.04


def test_two_cores_show_a_quarter_of_the_width_also_after_one_slow_frame():
    from deformrf.viewer.radiance_layer import CPU_MOVING_SECONDS

    moving = MovingResolution(CPU_MOVING_SECONDS)
    for k in range(30):
        moving.measured(0.4 if k == 10 else 0.125 * (moving.factor / 0.25) ** 2)
    assert moving.factor == pytest.approx(0.25)


def test_one_very_slow_frame_is_enough_to_go_down():
    moving = MovingResolution(0.04, 0)
    moving.measured(1.0)
    assert moving.factor**2 * 1.0 <= 1.25 * 0.04


def test_noise_does_not_make_it_flicker():
    moving = MovingResolution(0.04, 2)
    for k in range(100):
        moving.measured(0.03 * (1.3 if k % 2 else 0.7))
    assert moving.step == 2


def test_strips_cover_every_row_once():
    strips = Strips(100, budget_seconds=0.02)
    rows = []
    while not strips.done:
        first, last = strips.following()
        rows += range(first, last)
        strips.rendered((first, last), seconds=0.001 * (last - first))
    assert rows == list(range(100))


def test_strips_keep_to_their_budget():
    strips = Strips(1000, budget_seconds=0.02)
    strips.rendered(strips.following(), 0.004)
    first, last = strips.following()
    assert (last - first) * 0.001 == pytest.approx(0.02)


def test_no_size_is_empty():
    assert size_at(0.1, 12, 300) == (8, 30)


@pytest.mark.parametrize("factor", FACTORS[1:])
def test_refining_ends_at_the_full_resolution_in_at_most_two_goes(factor):
    assert factor < finer(factor) <= 1
    assert finer(finer(factor)) == 1.0
