"""Rays to pixels on CUDA in one kernel, for one color a ray: march, encoding, densities and sums.

A warp has 32 rays of the list.  They march until each has SLOTS samples.  Then the warp takes the
samples, front to back, through encoding and density network, and adds them up, until all rays are
opaque or out of samples; and they march again.  Rays that end leave their place to the next ones
of the list.  While some warps of a multiprocessor wait for the mesh, others wait for the table,
which takes less time than a march of all rays and then a network for all samples.  Of samples,
nothing is written but a warp's own few.

Rays that search for their entries are listed apart, and another kernel traces them at the same
time: the search takes registers, and one such ray takes as long as many others.

If pieces have to be sorted first, rounds do this instead (wavefront.py).
"""

import warp as wp

from ...base.wide import load_wide_own, vec4h
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
from ..rays.marching import Samples, march_ray
from ..rays.pose import Geometry
from .atomics import add_up, claim, count_of_warp
from .ray_color import Sums, rest_direction, store_sums
from .slot_densities import put_levels
from .slots import (
    BLOCK_SIZE,
    LISTED_APART,
    NEXT_LISTED,
    NEXT_RAY,
    NEXT_SEARCHING,
    SAMPLES,
    SEARCHING,
    Buffers,
    end_ray,
)

BLOCKS_PER_PROCESSOR, SEARCH_BLOCKS = 4, 3  # the registers suffice for no more
SLOTS = wp.constant(8)  # of a ray
FEWEST_RAYS = wp.constant(24)  # of a warp: with fewer, it takes others
# Of a ray, 2048 samples: as in training.  Among inverted tets a walk may go in circles, in poses
# that are not known to overlap yet.
MOST_MARCHES = wp.constant(256)

wp.set_module_options(
    {"enable_backward": False, "max_unroll": 2, "fast_math": True, "block_dim": BLOCK_SIZE}
)


@wp.func
def trace(
    geometry: Geometry,
    tables: Tables,
    table: wp.array(dtype=vec4h),  # [entries]
    nodes: wp.array(dtype=vec4h),  # node_table of the dense levels
    used_level_count: int,  # the finer ones count as zero
    weights: wp.array(dtype=vec4h),  # `fragments` of the density network
    biases: wp.array(dtype=float),
    stop: float,  # transmittance below which a ray ends
    own: Samples,  # [SLOTS · thread_count]
    thread_count: int,
    buffers: Buffers,
    first: int,  # the thread: its slots are first + k thread_count
    searches: bool,  # a constant: these rays are traced, else the others
):
    """What a thread of `trace_kernel` or `trace_searching_kernel` does."""
    shared = share_density(weights, biases)
    state = buffers.state
    ray_count = state[NEXT_LISTED]
    if searches:
        ray_count = state[SEARCHING]
    waiting = bool(True)  # there may be rays left
    ray = int(-1)
    direction = wp.vec3()
    transmittance = float(1.0)
    total_t = float(0.0)
    sample_count = int(0)
    march_count = int(0)
    s = Sums()
    turned = wp.vec3()  # in the last sample's tet
    last_tet = int(-1)
    working = bool(True)
    while working:
        few = count_of_warp(ray >= 0) < FEWEST_RAYS
        if few and waiting and ray < 0:
            if searches:
                i = claim(state, NEXT_SEARCHING)
            else:
                i = claim(state, NEXT_RAY)
            if i < ray_count:
                ray = buffers.lists[wp.where(searches, LISTED_APART, 1 - LISTED_APART), i]
                direction = buffers.rays.directions[ray]
                transmittance = 1.0
                total_t = 0.0
                sample_count = 0
                march_count = 0
                s.a = wp.vec4()
                s.b = wp.vec4()
                s.c = wp.vec4()
                s.d = wp.vec4()
                s.direction = wp.vec3()
                last_tet = -1
            else:
                waiting = False
        count = int(0)
        if ray >= 0:
            count = march_ray(
                geometry, buffers.rays, ray, own, first, thread_count, SLOTS, searches=searches
            )
            march_count += 1
        n = int(first)
        last = first + count * thread_count
        going = n < last
        while any_of_warp(going):
            tet = int(0)
            if going:
                bary = load_wide_own(own.bary, n)
                tet = own.tet[n]
                level = put_levels(shared, tables, table, nodes, used_level_count, tet, bary)
                while level < OVERWRITTEN_LEVELS:
                    put_features(shared, level, wp.vec4())
                    level += 1
            density_in_shared(shared)
            if going:
                if tet != last_tet:
                    last_tet = tet
                    turned = rest_direction(buffers.rotations, tet, direction)
                remaining = wp.exp(-sigma_in_shared(shared) * own.length[n])
                w = transmittance * (1.0 - remaining)
                s.a += w * h_in_shared(shared, 0)
                s.b += w * h_in_shared(shared, 1)
                s.c += w * h_in_shared(shared, 2)
                s.d += w * h_in_shared(shared, 3)
                s.direction += w * turned
                total_t += w * own.t[n]
                transmittance *= remaining
                sample_count += 1
                n += thread_count
                going = n < last and transmittance >= stop
        goes_on = count == SLOTS and transmittance >= stop and march_count < MOST_MARCHES
        if ray >= 0 and not goes_on:
            if sample_count > 0:
                store_sums(s, True, ray, buffers.sums)
            add_up(state, SAMPLES, sample_count)
            end_ray(stop, buffers, ray, transmittance, wp.vec3(), total_t)
            ray = -1
        working = any_of_warp(ray >= 0 or waiting)


@wp.kernel(launch_bounds=(BLOCK_SIZE, BLOCKS_PER_PROCESSOR))
def trace_kernel(
    geometry: Geometry,
    tables: Tables,
    table: wp.array(dtype=vec4h),
    nodes: wp.array(dtype=vec4h),
    used_level_count: int,
    weights: wp.array(dtype=vec4h),
    biases: wp.array(dtype=float),
    stop: float,
    own: Samples,
    thread_count: int,
    buffers: Buffers,
):
    trace(
        geometry,
        tables,
        table,
        nodes,
        used_level_count,
        weights,
        biases,
        stop,
        own,
        thread_count,
        buffers,
        wp.tid(),
        False,
    )


@wp.kernel(launch_bounds=(BLOCK_SIZE, SEARCH_BLOCKS))
def trace_searching_kernel(
    geometry: Geometry,
    tables: Tables,
    table: wp.array(dtype=vec4h),
    nodes: wp.array(dtype=vec4h),
    used_level_count: int,
    weights: wp.array(dtype=vec4h),
    biases: wp.array(dtype=float),
    stop: float,
    own: Samples,
    thread_count: int,
    buffers: Buffers,
):
    trace(
        geometry,
        tables,
        table,
        nodes,
        used_level_count,
        weights,
        biases,
        stop,
        own,
        thread_count,
        buffers,
        wp.tid(),
        True,
    )
