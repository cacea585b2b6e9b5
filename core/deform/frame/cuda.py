"""One frame of the solver on a GPU, in one launch: n substeps, every color of every substep.

A launch per color costs 1.3 µs or more, whatever it does, and a substep has about 40 of
them.  Here one kernel does the whole frame and waits at a barrier between colors instead.
What it waits with, and where it keeps the positions, depends on the mesh's size:

    block  one block of threads, positions in its shared memory, __syncthreads
    grid   a block on most of the GPU's processors, positions in its L2 cache, a counter

Constraints are loaded two colors ahead, so that only positions are waited for behind a
barrier.  The order of colors is the same for both, so the results are.

Shared memory has eight banks of 16 bytes, and eight threads that want the same one wait
for each other.  Translates of one constraint are neighbors in the order (coloring.py), so
a vertex's bank is the parity of its lattice cell: then most eights have eight banks.

The substep itself is in xpbd.py and reference.py.  Shapes: V vertices, E edges, T tets.
"""

from pathlib import Path

import numpy as np
import warp as wp

from ...geometry import lattice_addresses
from ..arrays import FrameArrays
from ..constraints import COLLAPSED, STEP_LIMIT

wp.set_module_options({"enable_backward": False})

BLOCK_THREADS = 512
GRID_THREADS = 256
SHARED_VERTICES = 2688  # 16 bytes each; 48 KiB hold them and the ranges of colors
MOST_COLORS = 380  # of edges and tets together; 8 bytes each
BANKS = 8


def _kernel(grid, threads):
    """The kernel for one block or for a grid of them."""
    snippet = Path(__file__).with_suffix(".cu").read_text(encoding="utf-8")
    for name, value in {
        "GRID": int(grid),
        "THREADS": threads,
        "SHARED_VERTICES": SHARED_VERTICES,
        "MOST_COLORS": MOST_COLORS,
        "COLLAPSED": f"{COLLAPSED}f",
        "STEP_LIMIT": f"{STEP_LIMIT}f",
    }.items():
        snippet = snippet.replace(f"@{name}", str(value))

    @wp.func_native(snippet)
    def frame_native(
        frame: FrameArrays,
        slots: wp.array(dtype=int),
        bodies: wp.array(dtype=wp.vec4),
        previous: wp.array(dtype=wp.vec3),
        edge_slots: wp.array(dtype=wp.vec2i),
        edge_spans: wp.array(dtype=wp.vec4),
        tet_slots: wp.array(dtype=wp.vec4i),
        tet_spans: wp.array(dtype=wp.vec4),
        arrivals: wp.array(dtype=int),
        substep_count: int,
        has_volumes: int,
        has_springs: int,
        has_ground: int,
    ): ...

    @wp.kernel(module="unique", grid_stride=False, enable_backward=False, launch_bounds=threads)
    def frame_kernel(
        frame: FrameArrays,
        slots: wp.array(dtype=int),  # [V] where a block keeps each vertex
        bodies: wp.array(dtype=wp.vec4),  # [V] deltas and inverse masses, of a grid
        previous: wp.array(dtype=wp.vec3),  # [V] deltas at the substep's start
        edge_slots: wp.array(dtype=wp.vec2i),  # [edge_room]
        edge_spans: wp.array(dtype=wp.vec4),  # [edge_room] of the frame's start, and L
        tet_slots: wp.array(dtype=wp.vec4i),  # [tet_room]
        tet_spans: wp.array(dtype=wp.vec4),  # [3 tet_room] and 6 V0, a, 0
        arrivals: wp.array(dtype=int),  # [1] at barriers
        substep_count: int,
        has_volumes: int,
        has_springs: int,
        has_ground: int,
    ):
        frame_native(
            frame,
            slots,
            bodies,
            previous,
            edge_slots,
            edge_spans,
            tet_slots,
            tet_spans,
            arrivals,
            substep_count,
            has_volumes,
            has_springs,
            has_ground,
        )

    return frame_kernel


@wp.kernel(grid_stride=False)
def begin_kernel(
    frame: FrameArrays,
    slots: wp.array(dtype=int),  # [V]
    has_volumes: int,
    edge_slots: wp.array(dtype=wp.vec2i),  # [edge_room] out: -1 in entries that aren't used
    edge_spans: wp.array(dtype=wp.vec4),  # [edge_room] out: difference of the ends, and L
    tet_slots: wp.array(dtype=wp.vec4i),  # [tet_room] out: -1 in entries that aren't used
    tet_spans: wp.array(dtype=wp.vec4),  # [3 tet_room] out: corners minus the first; 6 V0, a, 0
):
    k = wp.tid()
    if k < frame.edge_room:
        e = frame.edge_vertices[k]
        if e[0] < frame.vertex_count:
            edge_slots[k] = wp.vec2i(slots[e[0]], slots[e[1]])
            u = frame.vertices[e[0]] - frame.vertices[e[1]]
            edge_spans[k] = wp.vec4(u[0], u[1], u[2], frame.edge_rest[k])
        else:
            edge_slots[k] = wp.vec2i(-1, -1)
    if has_volumes != 0 and k < frame.tet_room:
        t = frame.tet_vertices[k]
        if t[0] < frame.vertex_count:
            tet_slots[k] = wp.vec4i(slots[t[0]], slots[t[1]], slots[t[2]], slots[t[3]])
            origin = frame.vertices[t[0]]
            a = frame.vertices[t[1]] - origin
            b = frame.vertices[t[2]] - origin
            c = frame.vertices[t[3]] - origin
            tet_spans[k] = wp.vec4(a[0], a[1], a[2], frame.tet_rest[k])
            tet_spans[frame.tet_room + k] = wp.vec4(b[0], b[1], b[2], frame.tet_regularization[k])
            tet_spans[2 * frame.tet_room + k] = wp.vec4(c[0], c[1], c[2], 0.0)
        else:
            tet_slots[k] = wp.vec4i(-1, -1, -1, -1)


block_kernel = _kernel(False, BLOCK_THREADS)
grid_kernel = _kernel(True, GRID_THREADS)


class CudaFrame:
    """Runs frames of one solver on a GPU."""

    def __init__(self, frame: FrameArrays, rest_vertices, device):
        """Take the arrays to work on, and where vertices are at rest.  [V, 3]"""
        if frame.edge_color_count + frame.tet_color_count > MOST_COLORS:
            raise ValueError(
                f"constraints have {frame.edge_color_count} + {frame.tet_color_count} colors; "
                f"the solver takes {MOST_COLORS} on a GPU: some vertex has too many edges or tets"
            )
        self._frame, self._device = frame, device
        self.in_block = runs_in_block(len(rest_vertices))
        slots = bank_slots(rest_vertices) if self.in_block else np.arange(len(rest_vertices))

        def scratch(count, dtype):
            return wp.zeros(count, dtype=dtype, device=device)

        self._scratch = (
            wp.array(slots.astype(np.int32), device=device),
            scratch(1 if self.in_block else frame.vertex_count, wp.vec4),
            scratch(frame.vertex_count, wp.vec3),
            scratch(frame.edge_room, wp.vec2i),
            scratch(frame.edge_room, wp.vec4),
            scratch(frame.tet_room, wp.vec4i),
            scratch(3 * frame.tet_room, wp.vec4),
            scratch(1, int),
        )
        self._launches = {}

    def use_grid(self) -> None:
        """Run small meshes as large ones, to compare."""
        self.in_block = False
        slots, bodies, *others = self._scratch
        count = len(slots)
        slots.assign(np.arange(count, dtype=np.int32))
        self._scratch = slots, wp.zeros(count, dtype=wp.vec4, device=bodies.device), *others
        self._launches.clear()

    def run(self, substep_count: int, volumes: bool, springs: bool, ground: bool) -> None:
        """One frame; what isn't needed isn't done."""
        key = substep_count, volumes, springs, ground
        if key not in self._launches:
            threads = BLOCK_THREADS if self.in_block else GRID_THREADS
            # A power of two, all of which run at once: they wait for each other.
            blocks = 1 if self.in_block else 2 ** int(np.log2(self._device.sm_count))
            slots, _, _, *lists, _ = self._scratch
            self._launches[key] = (
                wp.launch(
                    begin_kernel,
                    max(self._frame.edge_room, self._frame.tet_room),
                    [self._frame, slots, int(volumes), *lists],
                    device=self._device,
                    record_cmd=True,
                ),
                wp.launch(
                    block_kernel if self.in_block else grid_kernel,
                    blocks * threads,
                    [self._frame, *self._scratch, *map(int, key)],
                    device=self._device,
                    block_dim=threads,
                    record_cmd=True,
                ),
            )
        for launch in self._launches[key]:
            launch.launch()


def runs_in_block(vertex_count: int) -> bool:
    """Whether positions fit into one block's shared memory."""
    return vertex_count <= SHARED_VERTICES


def bank_slots(rest_vertices):
    """Where a block keeps each vertex, so that neighboring threads find different banks.

    Args:
        rest_vertices: [V, 3]

    Returns:
        Slots, each once; a few are empty.  [V] int
    """
    count = len(rest_vertices)
    found = lattice_addresses(rest_vertices)
    if found is None:
        return np.arange(count)
    lattice, addresses, _ = found
    bank = (addresses // lattice.cell_edge % 2) @ (1, 2, 4)
    order = np.argsort(bank, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(bank, minlength=BANKS))])
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count) - starts[bank[order]]
    slots = BANKS * rank + bank
    return slots if slots.max() < SHARED_VERTICES else np.arange(count)
