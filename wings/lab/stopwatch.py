"""Times an action: the median over repeats after a warm-up, with its spread.

On CUDA, events on the stream measure it, so that neither earlier launches nor the host's
clock enter.  Two actions that are compared take turns, so that other load on the machine
affects both.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

LOW, HIGH = 10.0, 90.0  # percentiles that say how far repeats spread
WARM_UP = 3


@dataclass(frozen=True)
class Spread:
    """The values of repeats: milliseconds, unless another unit is named."""

    median: float
    low: float  # tenth percentile
    high: float  # ninetieth percentile
    count: int  # of repeats


@dataclass(frozen=True)
class Share(Spread):
    """The time of one action relative to that of another in the same turn [%]."""


def spread_of(repeats, kind=Spread) -> Spread:
    """The spread of single repeats [n]."""
    low, median, high = np.percentile(repeats, [LOW, 50.0, HIGH])
    return kind(float(median), float(low), float(high), len(repeats))


def in_turns(with_it, without) -> tuple[Spread, Spread, Spread]:
    """Spreads of turns with something [n] and without it [n], and of the difference."""
    with_it, without = np.asarray(with_it), np.asarray(without)
    return spread_of(with_it), spread_of(without), spread_of(with_it - without)


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


def compared(with_it: Callable[[], object], without: Callable[[], object], device, repeats: int):
    """Spreads of the times of two actions that take turns, see in_turns."""
    for _ in range(WARM_UP):
        with_it(), without()
    times = {with_it: [], without: []}
    for repeat in range(repeats):
        for action in (with_it, without) if repeat % 2 else (without, with_it):
            times[action].append(milliseconds(action, device))
    return in_turns(times[with_it], times[without])
