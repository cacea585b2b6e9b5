"""The march of a round on CUDA: listed rays to slots.

With the search of the boundary (`enter_mesh`) in it, the march takes 132 registers a thread, and a
multiprocessor of an H100 runs 12 warps; without it, 93 registers and 20 warps.  A march waits for
memory most of the time, and more warps hide more of that.  So the few rays that have to search
are marched by another kernel, at the same time.  If it ran after the first one, its longest search
would lengthen each round.

Unlike the march on a CPU, this one does not stop a ray early where dense samples are expected:
more rays would need another round, and a round takes longer than the samples that it saves.
"""

import warp as wp

from ..rays.entries import UNKNOWN
from ..rays.marching import march_ray
from ..rays.pose import Geometry
from .slots import BLOCK_SIZE, PARITY, PER_RAY, STRIDE, TAKEN, Buffers

SEARCHING_THREADS = wp.constant(1 << 16)  # each looks at some of the rays

wp.set_module_options(
    {"enable_backward": False, "max_unroll": 2, "fast_math": True, "block_dim": BLOCK_SIZE}
)


@wp.func
def march_in_slots(
    geometry: Geometry,
    buffers: Buffers,
    i: int,
    ray: int,
    searches: bool,  # see next_entry
):
    """Let the listed ray i walk, and fill its slots."""
    state = buffers.state
    buffers.counts[i] = march_ray(
        geometry,
        buffers.rays,
        ray,
        buffers.slots,
        i,
        state[STRIDE],
        state[PER_RAY],
        searches=searches,
    )


@wp.func
def march_known(
    geometry: Geometry,
    buffers: Buffers,
    i: int,
    ray: int,
):
    """`march_in_slots`, unless the ray has to search: then search_slots_kernel does it."""
    if buffers.rays.entries.count[ray] != UNKNOWN:
        march_in_slots(geometry, buffers, i, ray, False)


@wp.kernel
def march_slots_kernel(
    geometry: Geometry,
    buffers: Buffers,
):
    i = wp.tid()
    state = buffers.state
    if i < state[TAKEN]:
        march_known(geometry, buffers, i, buffers.lists[state[PARITY], i])
    elif i < state[STRIDE]:
        buffers.counts[i] = 0


@wp.kernel
def search_slots_kernel(
    geometry: Geometry,
    buffers: Buffers,
):
    """March the rays that search for their entries; march_slots_kernel may run at the same time."""
    i = wp.tid()
    state = buffers.state
    while i < state[TAKEN]:
        ray = buffers.lists[state[PARITY], i]
        if buffers.rays.entries.count[ray] == UNKNOWN:
            march_in_slots(geometry, buffers, i, ray, True)
        i += SEARCHING_THREADS
