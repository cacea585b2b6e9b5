"""One frame of the solver on a GPU, in one launch: n substeps, every color of every substep.

A launch per color would cost at least 1.3 µs, and a substep has some 20 colors.  So one kernel
runs the whole frame, with a barrier between colors.  There are two forms of it; the mesh's size
determines which one runs:

    block  one block of threads; positions in its shared memory; the barrier is __syncthreads
    grid   a block on most multiprocessors; positions in the L2 cache; the barrier is a counter

A thread loads its next constraint before the barrier, so after it the thread waits only for
positions.  Both forms take the colors in the same order and give the same result.

Shared memory has eight banks of 16 bytes, and eight threads that access the same bank wait
for each other.  Translates of one constraint are neighbors in the order (coloring.py).  A vertex's
bank is the parity of its lattice cell, so most groups of eight threads use eight banks.

Shapes: V vertices; arrays have space for E edges and T tets.
"""

import numpy as np
import warp as wp

from ...geometry import lattice_addresses
from ..arrays import ContactArrays, FrameArrays, zeros
from .native import native_kernel

wp.set_module_options({"enable_backward": False})

BLOCK_THREADS = 512
GRID_THREADS = 256
SHARED_VERTICES = wp.constant(2688)  # 16 bytes each; 48 KiB hold them and the ranges of colors
MOST_COLORS = 380  # of edges and tets together; 8 bytes each
BANKS = 8


@wp.struct
class CudaScratch:
    """Arrays of a frame besides FrameArrays; unused entries have slots -1."""

    slots: wp.array(dtype=int)  # [V] where a block keeps each vertex in shared memory
    bodies: wp.array(dtype=wp.vec4)  # [V] deltas and inverse masses, of a grid
    previous: wp.array(dtype=wp.vec3)  # [V] deltas at the substep's start
    velocities: wp.array(dtype=wp.vec3)  # [V] in a substep that extrapolates
    edge_slots: wp.array(dtype=wp.vec2i)  # [E] of the ends; in a block packed, with a
    edge_spans: wp.array(dtype=wp.vec4)  # [E] difference of the ends at the frame's start; L
    tet_slots: wp.array(dtype=wp.vec4i)  # [T] of the corners
    tet_spans: wp.array(dtype=wp.vec4)  # [3 T] corners minus the first; 6 V0, a, 0
    arrivals: wp.array(dtype=int)  # [1] how many blocks have reached the barriers


def _kernel(grid, threads):
    """The kernel for one block or for a grid of them."""
    values = {
        "GRID": int(grid),
        "THREADS": threads,
        "SHARED_VERTICES": SHARED_VERTICES,
        "THREAD_VERTICES": -(-SHARED_VERTICES // threads),
        "MOST_COLORS": MOST_COLORS,
    }
    kernel = native_kernel("cuda.cu", CudaScratch, values, module="unique", launch_bounds=threads)
    kernel.module.options["block_dim"] = threads  # of launches; what we ship is compiled for it
    return kernel


@wp.func
def packed(first: int, second: int, regularization: float):
    """Where an edge's ends are in a block's shared memory [16 bytes], in 16 bits each; and a."""
    places = wp.uint32(first) << wp.uint32(4) | wp.uint32(second) << wp.uint32(20)
    return wp.vec2i(wp.cast(places, wp.int32), wp.cast(regularization, wp.int32))


@wp.kernel(grid_stride=False)
def begin_kernel(frame: FrameArrays, scratch: CudaScratch, has_volumes: int, in_block: int):
    k = wp.tid()
    if k == 0:
        frame.motion[0] = 0.0
    vertex_count = frame.state.vertices.shape[0]
    edges = frame.edges.vertices
    if k < edges.shape[0]:
        if edges[k, 0] < vertex_count:
            first, second = scratch.slots[edges[k, 0]], scratch.slots[edges[k, 1]]
            scratch.edge_slots[k] = wp.vec2i(first, second)
            if in_block != 0:
                scratch.edge_slots[k] = packed(first, second, frame.edges.regularization[k])
            u = frame.state.vertices[edges[k, 0]] - frame.state.vertices[edges[k, 1]]
            scratch.edge_spans[k] = wp.vec4(u[0], u[1], u[2], frame.edges.rest_values[k])
        else:
            scratch.edge_slots[k] = wp.vec2i(-1, -1)
            if in_block != 0:  # an edge at rest, between vertices without mass
                scratch.edge_slots[k] = packed(SHARED_VERTICES, SHARED_VERTICES, 1.0)
                scratch.edge_spans[k] = wp.vec4(1.0, 0.0, 0.0, 1.0)
    tets = frame.volumes.vertices
    space = tets.shape[0]
    if has_volumes != 0 and k < space:
        if tets[k, 0] < vertex_count:
            slots = wp.vec4i()
            for i in range(4):
                slots[i] = scratch.slots[tets[k, i]]
            scratch.tet_slots[k] = slots
            origin = frame.state.vertices[tets[k, 0]]
            last = wp.vec3(frame.volumes.rest_values[k], frame.volumes.regularization[k], 0.0)
            for i in range(3):
                u = frame.state.vertices[tets[k, i + 1]] - origin
                scratch.tet_spans[i * space + k] = wp.vec4(u[0], u[1], u[2], last[i])
        else:
            scratch.tet_slots[k] = wp.vec4i(-1, -1, -1, -1)


block_kernel = _kernel(False, BLOCK_THREADS)
grid_kernel = _kernel(True, GRID_THREADS)


class CudaFrame:
    """Runs frames of one solver on a GPU."""

    def __init__(self, frame: FrameArrays, rest_vertices, device):
        """Take the arrays to work on, and where vertices are at rest.  [V, 3]

        Raises:
            ValueError: The constraints have too many colors for a block's shared memory.
        """
        edge_colors, tet_colors = len(frame.edges.offsets) - 1, len(frame.volumes.offsets) - 1
        if edge_colors + tet_colors > MOST_COLORS:
            raise ValueError(
                f"constraints have {edge_colors} + {tet_colors} colors; the solver takes "
                f"{MOST_COLORS} on a GPU: some vertex has too many edges or tets"
            )
        self._frame, self._device = frame, device
        self._launches = {}
        count = len(rest_vertices)
        self._in_block = runs_in_block(count)
        edge_space, tet_space = len(frame.edges.ids), len(frame.volumes.ids)

        self._scratch = zeros(
            CudaScratch,
            device,
            slots=count,
            bodies=1 if self._in_block else count,
            previous=count,
            velocities=count,
            edge_slots=edge_space,
            edge_spans=edge_space,
            tet_slots=tet_space,
            tet_spans=3 * tet_space,
            arrivals=1,
        )
        slots = bank_slots(rest_vertices) if self._in_block else np.arange(count)
        self._scratch.slots.assign(slots.astype(np.int32))

    def set_contacts(self, contacts: ContactArrays) -> None:
        """Take other arrays of contacts."""
        self._frame.contacts = contacts
        self._launches.clear()

    def run(self, substep_count: int, *facts: int) -> None:
        """Run one frame, as `CpuFrame.run` does."""
        key = substep_count, *facts
        if key not in self._launches:
            threads = BLOCK_THREADS if self._in_block else GRID_THREADS
            # A power of two, all of which run at once: they wait for each other.
            blocks = 1 if self._in_block else 2 ** int(np.log2(self._device.sm_count))
            self._launches[key] = (
                wp.launch(
                    begin_kernel,
                    max(len(self._frame.edges.ids), len(self._frame.volumes.ids)),
                    [self._frame, self._scratch, int(facts[0]), int(self._in_block)],
                    device=self._device,
                    record_cmd=True,
                ),
                wp.launch(
                    block_kernel if self._in_block else grid_kernel,
                    blocks * threads,
                    [self._frame, self._scratch, *map(int, key), 0, 1],
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
    """Slots of vertices in shared memory, by banks as above; a few stay empty.  [V] int"""
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
