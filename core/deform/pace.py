"""The number of threads for a frame on a CPU, measured while frames run."""

from ..device import thread_count

MOST_THREADS = 8
TETS_PER_THREAD = 2000  # with fewer, barriers cost more than a thread saves
TRIAL = 3  # frames with the other number of threads, to compare
FIRST_PAUSE, LONGEST_PAUSE = 120, 4000  # frames between trials


class Pace:
    """Chooses the faster of two numbers of threads: one, or the limit.

    Threads wait for each other about 40 times a substep.  Where another program keeps a
    core busy, each wait may cost a time slice, and one thread is faster.
    """

    def __init__(self, limit: int):
        self._limit = limit
        self.thread_count = limit
        self._seconds = {1: [], limit: []}  # per substep, in the newest trial of each
        self._frames = 0  # with this number of threads since the last trial
        self._pause = FIRST_PAUSE

    def note(self, seconds: float) -> None:
        """Take a frame's time per substep; `thread_count` may change."""
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
    """The largest number of threads that a mesh may use on this machine."""
    return max(1, min(thread_count(), tet_count // TETS_PER_THREAD, MOST_THREADS))
