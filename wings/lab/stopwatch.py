"""Times an action: the median over repeats after a warm-up, with its spread.

On CUDA, events on the stream measure it, so that neither earlier launches nor the host's
clock enter.  Two actions that are compared take turns, so that other load on the machine
affects both.
"""

import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import warp as wp

LOW, HIGH = 10.0, 90.0  # percentiles that say how far repeats spread
WARM_UP = 3
HELD_STEPS = 200_000  # of one thread, each waits for the one before: some 10 ms, launches 1 to 3


@dataclass(frozen=True)
class Timing:
    """The times of a repeated action: milliseconds, unless another unit is named."""

    median: float
    low: float  # tenth percentile
    high: float  # ninetieth percentile
    count: int  # of repeats


@dataclass(frozen=True)
class Share(Timing):
    """The time of one action relative to that of another in the same turn [%]."""


def timing_of(repeats, kind=Timing) -> Timing:
    """The timing of single repeats [n]."""
    low, median, high = np.percentile(repeats, [LOW, 50.0, HIGH])
    return kind(float(median), float(low), float(high), len(repeats))


def in_turns(with_it, without) -> tuple[Timing, Timing, Timing]:
    """Timings of turns with something [n] and without it [n], and of the difference."""
    with_it, without = np.asarray(with_it), np.asarray(without)
    return timing_of(with_it), timing_of(without), timing_of(with_it - without)


def milliseconds(action: Callable[[], object], device) -> float:
    """Milliseconds of one call, including everything that it launches on the device."""
    device = wp.get_device(device)
    if not device.is_cuda:
        start = time.perf_counter()
        action()
        return 1e3 * (time.perf_counter() - start)
    first, last = (wp.Event(device, enable_timing=True) for _ in range(2))
    stream = wp.get_stream(device)
    wp.synchronize_device(device)
    stream.record_event(first)
    action()
    stream.record_event(last)
    wp.synchronize_event(last)
    return wp.get_event_elapsed_time(first, last)


@wp.kernel(enable_backward=False)
def hold_back_kernel(count: int, value: wp.array(dtype=float)):
    x = value[0]
    for _ in range(count):
        x = wp.sin(x)
    value[0] = x


@contextmanager
def held_back(device):
    """On CUDA, keep the stream busy at first, so that launches within run without gaps.

    Otherwise work that is shorter than its own launch seems to take as long as the launch.
    """
    device = wp.get_device(device)
    if device.is_cuda:
        value = wp.full(1, 1.0, dtype=float, device=device)  # freed after the launches within
        wp.launch(hold_back_kernel, 1, [HELD_STEPS, value], device=device)
    yield


def timed(action: Callable[[], object], device, repeats: int, warm_up: int = WARM_UP) -> Timing:
    """The timing of an action."""
    for _ in range(warm_up):
        action()
    return timing_of([milliseconds(action, device) for _ in range(repeats)])


def compared(with_it: Callable[[], object], without: Callable[[], object], device, repeats: int):
    """Timings of two actions that take turns, see in_turns."""
    for _ in range(WARM_UP):
        with_it(), without()
    times = {with_it: [], without: []}
    for repeat in range(repeats):
        for action in (with_it, without) if repeat % 2 else (without, with_it):
            times[action].append(milliseconds(action, device))
    return in_turns(times[with_it], times[without])
