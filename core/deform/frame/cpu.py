"""One frame of the solver on a CPU: eight constraints at once, several threads.

Constraints of one color share no vertex, so eight of them are projected in the lanes of a
vector, and each thread takes a part of a color.  Between colors the threads wait for each
other at a barrier that spins: waiting for the operating system would take longer than a
color.  The result doesn't depend on the number of threads.

Unused entries of constraint lists (arrays.py) refer to a vertex V that has no mass.

reference.py defines the substep.  Shapes: V vertices.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from threading import Lock
from time import perf_counter

import warp as wp

from ..arrays import FrameArrays
from ..pace import MOST_THREADS, Pace, thread_limit
from .native import native_kernel, native_source

LINE = 16  # ints of a cache line, or half of one
EVERYONE = 2**30  # more arrivals than any barrier waits for


@wp.struct
class CpuScratch:
    """Arrays of a frame besides FrameArrays; E and T are the rooms for edges and tets."""

    bodies: wp.array(dtype=wp.vec4)  # [V + 1] deltas and inverse masses
    previous: wp.array(dtype=wp.vec4)  # [V] the same at the substep's start
    spans: wp.array(dtype=float)  # [3 E + 9 T] differences of vertices, by component
    lanes: wp.array(dtype=int)  # [2 E + 4 T] vertices of constraints, eight by eight
    arrivals: wp.array(dtype=int)  # [LINE · MOST_THREADS] barriers that each thread has reached


frame_kernel = native_kernel(
    native_source("cpu.cpp", LINE=LINE), CpuScratch, module=wp.get_module(__name__)
)


class CpuFrame:
    """Runs frames of one solver on a CPU."""

    def __init__(self, frame: FrameArrays):
        self._frame = frame
        vertex_count = len(frame.state.vertices)
        edge_room, tet_room = len(frame.edges.ids), len(frame.volumes.ids)
        self._scratch = scratch = CpuScratch()
        scratch.bodies = wp.zeros(vertex_count + 1, dtype=wp.vec4, device="cpu")
        scratch.previous = wp.zeros(vertex_count, dtype=wp.vec4, device="cpu")
        scratch.spans = wp.zeros(3 * edge_room + 9 * tet_room, dtype=float, device="cpu")
        scratch.lanes = wp.zeros(2 * edge_room + 4 * tet_room, dtype=int, device="cpu")
        scratch.arrivals = wp.zeros(LINE * MOST_THREADS, dtype=int, device="cpu")
        self._arrivals = scratch.arrivals.numpy()
        self._launches = {}
        self._pace = Pace(thread_limit(tet_room))

    def run(self, substep_count: int, volumes: bool, springs: bool, ground: bool) -> None:
        """Run one frame with the given parts of a substep."""
        thread_count = self._pace.thread_count
        key = thread_count, substep_count, volumes, springs, ground
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

    def _launch(self, part):
        try:
            part.launch()
        except BaseException:
            self._arrivals[:] = EVERYONE
            raise


_ONE_AT_A_TIME = Lock()


@cache
def _helpers():
    """The threads beside the calling one."""
    return ThreadPoolExecutor(MOST_THREADS - 1, "solver")
