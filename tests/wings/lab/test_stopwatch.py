"""Times: what is measured is what was done, and two things that take turns are told apart."""

import time

import numpy as np
import pytest
import warp as wp

from deformrf.wings.lab.stopwatch import compared, milliseconds, spread_of


def test_a_spread_is_median_and_percentiles():
    spread = spread_of(np.arange(101.0))
    assert (spread.low, spread.median, spread.high, spread.count) == (10.0, 50.0, 90.0, 101)


def test_a_sleep_takes_its_time():
    assert milliseconds(lambda: time.sleep(0.01), "cpu") > 9.9


def test_two_actions_take_turns():
    order = []
    with_it, without, _ = compared(
        lambda: order.append("with") or time.sleep(0.004),
        lambda: order.append("without") or time.sleep(0.001),
        "cpu",
        repeats=6,
    )
    turns = [sorted(order[i : i + 2]) for i in range(0, len(order), 2)]
    assert turns == [["with", "without"]] * 9  # three to warm up
    assert order.count("with") == 9 and order[6:8] != order[8:10]  # and the first one changes
    assert with_it.low > 3.9 and without.low > 0.9 and with_it.count == without.count == 6


@pytest.mark.gpu
def test_on_cuda_a_time_is_that_of_the_device():
    array = wp.zeros(1 << 26, dtype=float, device="cuda:0")
    other = wp.zeros(1 << 26, dtype=float, device="cuda:0")

    def median(count):
        def copy():
            for _ in range(count):
                wp.copy(other, array)

        return np.median([milliseconds(copy, "cuda:0") for _ in range(8)][3:])

    one, four = median(1), median(4)
    assert 0.05 < one < 5.0  # half a GB, read and written
    assert 3.0 < four / one < 5.0
