"""Work that several threads share: a launch of Warp's on a CPU is the work of one thread."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise

from .device import thread_count


def parts_of(count: int, least: int) -> list[tuple[int, int]]:
    """First and last + 1 of parts of `count` things, one for each thread.

    There are fewer parts where one would have fewer than `least` things.
    """
    parts = max(min(thread_count(), count // least), 1)
    return list(pairwise(count * k // parts for k in range(parts + 1)))


def side_by_side(tasks: list[Callable]) -> list:
    """What the tasks return; each runs in a thread of its own, the first in this one.

    No task may call this function: its threads could all be waiting.
    """
    first, *others = tasks
    running = [_helpers().submit(task) for task in others]
    try:
        mine = first()
    finally:
        theirs = [future.result() for future in running]
    return [mine, *theirs]


@cache
def _helpers():
    return ThreadPoolExecutor(max(thread_count() - 1, 1), "side by side")
