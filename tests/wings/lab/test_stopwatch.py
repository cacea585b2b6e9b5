"""Times: what is measured is what was done, and two things that take turns are told apart."""

import time

import numpy as np
import pytest
import warp as wp

from deformrf.wings.lab.stopwatch import compared, held_back, milliseconds, timed, timing_of


def test_a_timing_is_median_and_percentiles():
    timing = timing_of(np.arange(101.0))
    assert (timing.low, timing.median, timing.high, timing.count) == (10.0, 50.0, 90.0, 101)


def test_a_sleep_takes_its_time():
    assert 9.9 < milliseconds(lambda: time.sleep(0.01), "cpu") < 30.0
    calls = []
    timing = timed(lambda: calls.append(time.sleep(0.002)), "cpu", repeats=5, warm_up=2)
    assert len(calls) == 7 and timing.count == 5
    assert 1.9 < timing.low <= timing.median <= timing.high


def test_two_actions_take_turns():
    order = []
    with_it, without, more = compared(
        lambda: order.append("with") or time.sleep(0.004),
        lambda: order.append("without") or time.sleep(0.001),
        "cpu",
        repeats=6,
    )
    turns = [sorted(order[i : i + 2]) for i in range(0, len(order), 2)]
    assert turns == [["with", "without"]] * 9  # three to warm up
    assert order.count("with") == 9 and order[6:8] != order[8:10]  # and the first one changes
    assert with_it.median > without.median and more.low > 2.0 and more.median < 8.0


@pytest.mark.gpu
def test_on_cuda_a_time_is_that_of_the_device():
    array = wp.zeros(1 << 26, dtype=float, device="cuda:0")
    other = wp.zeros(1 << 26, dtype=float, device="cuda:0")
    timed(lambda: wp.copy(other, array), "cuda:0", 3)
    one = timed(lambda: wp.copy(other, array), "cuda:0", 5).median
    four = timed(lambda: [wp.copy(other, array) for _ in range(4)], "cuda:0", 5).median
    assert 0.05 < one < 5.0  # half a GB, read and written
    assert 3.0 < four / one < 5.0


@pytest.mark.gpu
def test_what_is_launched_meanwhile_runs_without_gaps():
    array = wp.zeros(1, dtype=float, device="cuda:0")

    def fill():
        for _ in range(100):
            array.fill_(1.0)

    def held():
        first, last = (wp.Event("cuda:0", enable_timing=True) for _ in range(2))
        with held_back("cuda:0"):
            wp.record_event(first)
            fill()
            assert not first.is_complete  # the host is ahead
            wp.record_event(last)
        wp.synchronize_event(last)
        return wp.get_event_elapsed_time(first, last)

    with wp.ScopedDevice("cuda:0"):
        held()  # compiles
        assert 0.0 < np.median([held() for _ in range(9)]) <= timed(fill, "cuda:0", 9).median
