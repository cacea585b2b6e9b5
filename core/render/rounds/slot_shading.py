"""Slots to pixels on CUDA, for one color a ray: encoding, density network, sums in one kernel.

A warp takes 32 neighboring rays of the list through their slots, front to back.  No sample is
written to memory, and samples behind the end of a ray are not evaluated.  If samples have to be
sorted first, `slot_densities_kernel` and a kernel that composites do this in two launches.
"""

import warp as wp

from ...base.wide import load_wide, vec4h
from ...field import (
    OVERWRITTEN_LEVELS,
    Tables,
    any_of_warp,
    density_in_shared,
    h_in_shared,
    put_features,
    share_density,
    sigma_in_shared,
)
from .atomics import add_up
from .ray_color import Sums, rest_direction, store_sums
from .slot_densities import put_levels
from .slots import (
    BLOCK_SIZE,
    LISTED,
    NEXT_TILE,
    PARITY,
    SAMPLES,
    STRIDE,
    TAKEN,
    Buffers,
    keep_or_finish,
    list_ray,
)

BLOCKS_PER_PROCESSOR = 5  # the registers suffice for no more
WARP = wp.constant(32)

wp.set_module_options(
    {"enable_backward": False, "max_unroll": 2, "fast_math": True, "block_dim": BLOCK_SIZE}
)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    int tile = 0;
    if ((threadIdx.x & 31) == 0) tile = atomicAdd(&wp::index(state, place), 1);
    return __shfl_sync(0xffffffffu, tile, 0);
#else
    return wp::atomic_add(state, place, 1);
#endif
""")
def claim_tile(state: wp.array(dtype=int), place: int) -> int:
    """The next tile for this warp."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return threadIdx.x & 31;
#else
    return 0;
#endif
""")
def lane_of_warp() -> int: ...


@wp.kernel(launch_bounds=(BLOCK_SIZE, BLOCKS_PER_PROCESSOR))
def shade_slots_kernel(
    tables: Tables,
    table: wp.array(dtype=vec4h),  # [entries]
    nodes: wp.array(dtype=vec4h),  # node_table of the dense levels
    used_level_count: int,  # the finer ones count as zero
    weights: wp.array(dtype=vec4h),  # `fragments` of the density network
    biases: wp.array(dtype=float),
    stop: float,  # transmittance below which a ray ends
    buffers: Buffers,
):
    shared = share_density(weights, biases)
    state = buffers.state
    stride = state[STRIDE]
    lane = lane_of_warp()
    tile_count = (state[LISTED] + WARP - 1) / WARP
    tile = claim_tile(state, NEXT_TILE)
    while tile < tile_count:
        i = tile * WARP + lane
        ray = int(-1)
        last = int(0)
        transmittance = float(1.0)
        total_t = float(0.0)
        if i < state[LISTED]:
            ray = buffers.lists[state[PARITY], i]
        if i < state[TAKEN]:
            last = i + buffers.counts[i] * stride
            transmittance = buffers.pixels.transmittance[ray]
            total_t = buffers.pixels.depth[ray]
        s = Sums()
        turned = wp.vec3()  # in the last slot's tet
        last_tet = int(-1)
        n = int(i)
        going = n < last and transmittance >= stop
        while any_of_warp(going):
            tet = int(0)
            if going:
                bary = load_wide(buffers.slots.bary, n)
                tet = buffers.slots.tet[n]
                level = put_levels(shared, tables, table, nodes, used_level_count, tet, bary)
                while level < OVERWRITTEN_LEVELS:
                    put_features(shared, level, wp.vec4())
                    level += 1
            density_in_shared(shared)
            if going:
                if tet != last_tet:
                    last_tet = tet
                    turned = rest_direction(buffers.rotations, tet, buffers.rays.directions[ray])
                remaining = wp.exp(-sigma_in_shared(shared) * buffers.slots.length[n])
                w = transmittance * (1.0 - remaining)
                s.a += w * h_in_shared(shared, 0)
                s.b += w * h_in_shared(shared, 1)
                s.c += w * h_in_shared(shared, 2)
                s.d += w * h_in_shared(shared, 3)
                s.direction += w * turned
                total_t += w * buffers.slots.t[n]
                transmittance *= remaining
                n += stride
                going = n < last and transmittance >= stop
        if i < state[TAKEN]:
            if n > i:
                fresh = buffers.pixels.transmittance[ray] == 1.0
                store_sums(s, fresh, ray, buffers.sums)
            add_up(state, SAMPLES, (n - i) / stride)
            keep_or_finish(stop, buffers, ray, transmittance, wp.vec3(), total_t)
        elif i < state[LISTED]:
            list_ray(buffers, ray)
        tile = claim_tile(state, NEXT_TILE)
