"""Divide work among threads.  On a CPU, Warp runs a launch in one thread."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from itertools import pairwise

from .device import thread_count


def shares_of(count: int, least: int) -> list[tuple[int, int]]:
    """First and last + 1 of the share of `count` things that each thread has.

    There are fewer shares where one would have fewer than `least` things.
    """
    shares = max(min(thread_count(), count // least), 1)
    return list(pairwise(count * k // shares for k in range(shares + 1)))


def side_by_side(tasks: list[Callable]) -> list:
    """What the tasks return; the first runs in this thread, each other one in one of its own.

    An error comes when all have ended.  No task may call this function: its threads could all be
    waiting.
    """
    first, *others = tasks
    running = []
    try:
        running += [_helpers().submit(task) for task in others]
        mine = first()
    finally:
        wait(running)
    return [mine, *(future.result() for future in running)]


def counted(launches: list[tuple]):
    """Run wp.Launches side by side, each with the array that it counts in; the sum of these."""
    for _, counts in launches:
        counts[:] = 0
    side_by_side([launch.launch for launch, _ in launches])
    return sum(counts for _, counts in launches)


@cache
def _helpers():
    return ThreadPoolExecutor(max(thread_count() - 1, 1), "side by side")
