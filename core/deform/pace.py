"""How many threads a frame is worth on a CPU, found out while it runs."""

from ..device import thread_count

MOST_THREADS = 8
TETS_PER_THREAD = 2000  # fewer aren't worth the barriers
TRIAL = 3  # frames with another number of threads, to see which is faster
FIRST_PAUSE, LONGEST_PAUSE = 120, 4000  # frames between trials


class Pace:
    """How many threads are faster here and now: one, or as many as there may be.

    Threads wait for each other about 40 times a substep.  Where something else keeps a
    core busy, each of those times may cost a time slice, and one thread is faster.
    """

    def __init__(self, limit: int):
        self._limit = limit
        self.thread_count = limit
        self._seconds = {1: [], limit: []}  # of a substep, in the newest trial of each
        self._frames = 0  # with this number of threads since the last trial
        self._pause = FIRST_PAUSE

    def note(self, seconds: float) -> None:
        """A frame took so long, per substep; the number of threads may be another now."""
        if self._limit == 1:
            return
        times = self._seconds[self.thread_count]
        times.append(seconds)
        del times[:-TRIAL]
        self._frames += 1
        if len(times) < TRIAL:
            return
        other = self._limit if self.thread_count == 1 else 1
        if len(self._seconds[other]) < TRIAL:
            self._change(other)
        elif min(self._seconds[other]) < min(times):
            self._pause = min(2 * self._pause, LONGEST_PAUSE) if other == 1 else FIRST_PAUSE
            self._change(other)
        elif self._frames >= self._pause:
            self._seconds[other].clear()
            self._change(other)

    def _change(self, thread_count):
        self.thread_count = thread_count
        self._frames = 0


def thread_limit(tet_count: int) -> int:
    """How many threads a mesh is worth on this machine."""
    return max(1, min(thread_count(), tet_count // TETS_PER_THREAD, MOST_THREADS))
