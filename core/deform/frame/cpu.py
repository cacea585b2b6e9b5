"""One frame of the solver on a CPU: eight constraints at once, several threads.

Constraints of one color share no vertex, so eight of them are projected at once, in the lanes of a
vector.  A mesh of some ten thousand tets is cut in two halves (halves.py), one for each of two
threads.  In larger meshes, the threads share each color.  A thread that waits for another one
spins, because waiting through the operating system would take longer than a color.  The result
depends neither on the cut nor on the number of threads.

Shapes: V vertices.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from threading import Lock
from time import perf_counter

import numpy as np
import warp as wp

from ...base.device import thread_count as usable_threads
from ..arrays import MOST_THREADS, ContactArrays, FrameArrays, zeros
from ..halves import Halves
from .native import native_kernel

LINE = 16  # ints of a cache line, or half of one
EVERYONE = 2**30  # more arrivals than any barrier waits for
TETS_PER_THREAD = 2000  # with fewer, barriers cost more than a thread saves
TRIAL = 3  # frames with the other number of threads, to compare
FIRST_PAUSE, LONGEST_PAUSE = 120, 4000  # frames between trials


@wp.struct
class CpuScratch:
    """Arrays of a frame besides FrameArrays; E and T are the spaces for edges and tets."""

    bodies: wp.array(dtype=wp.vec4)  # [V + 1] deltas and inverse masses, by slot
    previous: wp.array(dtype=wp.vec4)  # [V] what is kept of them in a substep, by slot
    velocities: wp.array(dtype=wp.vec4)  # [V] in a substep that extrapolates, by slot
    slots: wp.array(dtype=int)  # [V + 1] of vertices
    order: wp.array(dtype=int)  # [V] the vertex in each slot
    halves: wp.array(dtype=int)  # [5] Halves.starts; 0 if there are none
    spans: wp.array(dtype=float)  # [3 E + 9 T] differences of vertices, by component
    lanes: wp.array(dtype=int)  # [2 E + 4 T] vertices of constraints, eight by eight
    arrivals: wp.array(dtype=int)  # [LINE · MOST_THREADS] how far each thread has come


frame_kernel = native_kernel("cpu.cpp", CpuScratch, {"LINE": LINE}, module=wp.get_module(__name__))


class CpuFrame:
    """Runs frames of one solver on a CPU."""

    def __init__(self, frame: FrameArrays, halves: Halves | None = None):
        """Take the arrays to work on, and the mesh's halves."""
        self._frame = frame
        vertex_count = len(frame.state.vertices)
        edge_space, tet_space = len(frame.edges.ids), len(frame.volumes.ids)
        self._scratch = zeros(
            CpuScratch,
            "cpu",
            bodies=vertex_count + 1,
            previous=vertex_count,
            velocities=vertex_count,
            slots=vertex_count + 1,
            order=vertex_count,
            halves=5,
            spans=3 * edge_space + 9 * tet_space,
            lanes=2 * edge_space + 4 * tet_space,
            arrivals=LINE * MOST_THREADS,
        )
        order = np.arange(vertex_count) if halves is None else halves.order
        self._scratch.order.assign(order.astype(np.int32))
        slots = np.argsort(np.append(order, vertex_count), kind="stable")
        self._scratch.slots.assign(slots.astype(np.int32))
        if halves is not None:
            self._scratch.halves.assign(halves.starts.astype(np.int32))
        self._arrivals = self._scratch.arrivals.numpy()
        self._launches = {}
        limit = thread_limit(tet_space) if halves is None else 2
        self._pace = Pace(limit)

    def set_contacts(self, contacts: ContactArrays) -> None:
        """Take other arrays of contacts."""
        self._frame.contacts = contacts
        self._launches.clear()

    def run(self, substep_count: int, *facts: int) -> None:
        """Run one frame.

        Args:
            facts: Whether there are volumes, springs, a ground and free parts, the number of
                colliders, and whether there are contacts.
        """
        thread_count = self._pace.thread_count
        key = thread_count, substep_count, *facts
        if key not in self._launches:
            self._launches[key] = [
                wp.launch(
                    frame_kernel,
                    1,
                    [self._frame, self._scratch, *map(int, key[1:]), thread, thread_count],
                    device="cpu",
                    record_cmd=True,
                )
                for thread in range(thread_count)
            ]
        mine, *others = self._launches[key]
        start = perf_counter()
        running = []
        with _ONE_AT_A_TIME:  # two frames at once would wait for each other's helpers
            self._arrivals[:] = 0
            try:
                running += [_helpers().submit(self._launch, other) for other in others]
                self._launch(mine)
            except BaseException:  # Ctrl-C: helpers must not wait for a thread that never comes
                self._arrivals[:] = EVERYONE
                raise
            finally:
                for helper in running:
                    helper.result()
        self._pace.note((perf_counter() - start) / substep_count)

    def _launch(self, launch):
        try:
            launch.launch()
        except BaseException:
            self._arrivals[:] = EVERYONE
            raise


_ONE_AT_A_TIME = Lock()


@cache
def _helpers():
    """The threads beside the calling one."""
    return ThreadPoolExecutor(MOST_THREADS - 1, "solver")


class Pace:
    """Chooses the faster of two numbers of threads, one or the limit, while frames run.

    Threads wait for each other some 20 times a substep.  Where another program keeps a
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
    return max(1, min(usable_threads(), tet_count // TETS_PER_THREAD, MOST_THREADS))


def takes_halves() -> bool:
    """Whether a mesh is worth cutting: with more threads than two, sharing colors gains more."""
    return usable_threads() == 2
