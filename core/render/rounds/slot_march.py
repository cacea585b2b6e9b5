"""The march of a round on CUDA: listed rays to slots.

With the search of the boundary (`enter_mesh`) in it, the march takes 135 registers a thread, and
12 warps fit a processor of an H100; without it 96, and 20 warps.  A march waits for memory most of
the time, so more warps hide more of it.  The few rays that have to search are put off to
`search_slots_kernel`.
"""

import warp as wp

from ..rays import FILL_SLOTS, MIDDLE, UNKNOWN, Geometry, march_ray
from .slots import BLOCK_SIZE, LATER, PARITY, PER_RAY, STRIDE, TAKEN, Buffers, claim

SEARCHING_THREADS = wp.constant(1 << 16)  # each takes some of the rays that search

wp.set_module_options(
    {"enable_backward": False, "max_unroll": 2, "fast_math": True, "block_dim": BLOCK_SIZE}
)


@wp.func
def march_in_slots(
    geometry: Geometry,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    step: float,  # Δ
    stop: float,  # transmittance below which a ray ends
    buffers: Buffers,
    i: int,
    searches: bool,
):
    """Let the listed ray i walk, and fill its slots; returns how many."""
    state = buffers.state
    ray = buffers.lists[state[PARITY], i]
    return march_ray(
        geometry,
        buffers.entries,
        occupancy,
        buffers.rays,
        ray,
        step,
        MIDDLE,
        FILL_SLOTS,
        i,
        state[STRIDE],
        state[PER_RAY],
        buffers.slots,
        buffers.densities,
        wp.log(buffers.pixels.transmittance[ray] / stop),
        searches,
    )


@wp.func
def march_or_put_off(
    geometry: Geometry,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    step: float,
    stop: float,
    buffers: Buffers,
    i: int,
    ray: int,
):
    """`march_in_slots`, unless the ray has to search: then search_slots_kernel does it."""
    count = int(0)
    if buffers.entries.count[ray] == UNKNOWN:
        buffers.later[claim(buffers.state, LATER)] = i
    else:
        count = march_in_slots(geometry, occupancy, step, stop, buffers, i, False)
    return count


@wp.kernel
def march_slots_kernel(
    geometry: Geometry,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    step: float,  # Δ
    stop: float,  # transmittance below which a ray ends
    buffers: Buffers,
):
    i = wp.tid()
    state = buffers.state
    if i >= state[STRIDE]:
        return
    count = int(0)
    if i < state[TAKEN]:
        ray = buffers.lists[state[PARITY], i]
        count = march_or_put_off(geometry, occupancy, step, stop, buffers, i, ray)
    buffers.counts[i] = count


@wp.kernel
def search_slots_kernel(
    geometry: Geometry,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    step: float,  # Δ
    stop: float,  # transmittance below which a ray ends
    buffers: Buffers,
):
    """March the rays that were put off."""
    n = wp.tid()
    while n < buffers.state[LATER]:
        i = buffers.later[n]
        buffers.counts[i] = march_in_slots(geometry, occupancy, step, stop, buffers, i, True)
        n += SEARCHING_THREADS
