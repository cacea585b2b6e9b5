"""One frame of the solver on a CPU: eight constraints at once, several threads.

Constraints of one color share no vertex, so eight of them are projected in the lanes of a
vector, and threads take parts of a color.  They meet at a barrier between colors, which
spins: waiting for the operating system would take longer than a color.  The result doesn't
depend on the number of threads.

Entries that aren't used (arrays.py) are about a vertex V that has no mass.

The substep itself is in xpbd.py and reference.py.  Shapes: V vertices, E edges, T tets.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from threading import Lock
from time import perf_counter

import warp as wp

from ..arrays import FrameArrays
from ..constraints import COLLAPSED, STEP_LIMIT
from ..pace import MOST_THREADS, Pace, thread_limit

wp.set_module_options({"enable_backward": False})


LINE = 16  # ints of a cache line, or half of one
EVERYONE = 2**30  # arrivals beyond any barrier

_SOURCE = Path(__file__).with_suffix(".cpp").read_text(encoding="utf-8")


@wp.func_native(
    _SOURCE.replace("@COLLAPSED", f"{COLLAPSED}f")
    .replace("@STEP_LIMIT", f"{STEP_LIMIT}f")
    .replace("@LINE", str(LINE))
)
def frame_native(
    frame: FrameArrays,
    bodies: wp.array(dtype=wp.vec4),
    previous: wp.array(dtype=wp.vec4),
    spans: wp.array(dtype=float),
    lanes: wp.array(dtype=int),
    arrivals: wp.array(dtype=int),
    substep_count: int,
    has_volumes: int,
    has_springs: int,
    has_ground: int,
    thread: int,
    thread_count: int,
): ...


@wp.kernel(grid_stride=False)
def frame_kernel(
    frame: FrameArrays,
    bodies: wp.array(dtype=wp.vec4),  # [V + 1] deltas and inverse masses
    previous: wp.array(dtype=wp.vec4),  # [V] at the substep's start
    spans: wp.array(dtype=float),  # [3 edge_room + 9 tet_room] of the frame's start, by component
    lanes: wp.array(dtype=int),  # [2 edge_room + 4 tet_room] vertices, eight by eight
    arrivals: wp.array(dtype=int),  # [LINE · threads] at barriers, 0 when the frame begins
    substep_count: int,
    has_volumes: int,
    has_springs: int,
    has_ground: int,
    thread: int,
    thread_count: int,
):
    frame_native(
        frame,
        bodies,
        previous,
        spans,
        lanes,
        arrivals,
        substep_count,
        has_volumes,
        has_springs,
        has_ground,
        thread,
        thread_count,
    )


class CpuFrame:
    """Runs frames of one solver on a CPU."""

    def __init__(self, frame: FrameArrays):
        self._frame = frame
        span_count = 3 * frame.edge_room + 9 * frame.tet_room
        lane_count = 2 * frame.edge_room + 4 * frame.tet_room
        self._scratch = (
            wp.zeros(frame.vertex_count + 1, dtype=wp.vec4, device="cpu"),
            wp.zeros(frame.vertex_count, dtype=wp.vec4, device="cpu"),
            wp.zeros(span_count, dtype=float, device="cpu"),
            wp.zeros(lane_count, dtype=int, device="cpu"),
            wp.zeros(LINE * MOST_THREADS, dtype=int, device="cpu"),
        )
        self._arrivals = self._scratch[-1].numpy()
        self._launches = {}
        self._pace = Pace(thread_limit(frame.tet_room))

    def run(self, substep_count: int, volumes: bool, springs: bool, ground: bool) -> None:
        """One frame; what isn't needed isn't done."""
        thread_count = self._pace.thread_count
        key = thread_count, substep_count, volumes, springs, ground
        if key not in self._launches:
            self._launches[key] = [
                wp.launch(
                    frame_kernel,
                    1,
                    [self._frame, *self._scratch, *map(int, key[1:]), thread, thread_count],
                    device="cpu",
                    record_cmd=True,
                )
                for thread in range(thread_count)
            ]
        mine, *others = self._launches[key]
        start = perf_counter()
        running = []
        with _ONE_AT_A_TIME:  # two solvers would wait for helpers that the other one holds
            self._arrivals[:] = 0
            try:
                running += [_helpers().submit(self._launch, other) for other in others]
                self._launch(mine)
            except BaseException:  # Ctrl-C between them: nobody must wait for who isn't there
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
