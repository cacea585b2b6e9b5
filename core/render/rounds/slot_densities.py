"""Slots to density and h on CUDA, for one color a ray: encoding, density network in one kernel.

`encode_slots_kernel` and the networks' kernel do the same in two launches.  Between them they
write the features to memory and read them again: 56 bytes for each slot.
"""

import warp as wp

from ...base.wide import load_wide, vec4h
from ...field import Tables, any_of_warp, density_of_rows, encoded_half, put_features, share_density
from ...geometry import lattice_point
from .slots import BLOCK_SIZE, STRIDE, TOTAL, Buffers

BLOCKS_PER_PROCESSOR = 7  # the registers suffice for no more

wp.set_module_options(
    {"enable_backward": False, "max_unroll": 2, "fast_math": True, "block_dim": BLOCK_SIZE}
)


@wp.func
def put_levels(
    shared: wp.uint64,
    tables: Tables,
    table: wp.array(dtype=vec4h),  # [entries]
    nodes: wp.array(dtype=vec4h),  # node_table of the dense levels
    used_level_count: int,
    tet: int,
    bary: wp.vec4,
):
    """Encode a sample and put its features; returns the level behind the last one."""
    x = lattice_point(bary)
    products = tables.products[tet]
    level = int(0)
    while level < used_level_count:
        put_features(shared, level, encoded_half(tables, table, nodes, level, tet, x, products))
        level += 1
    return level


@wp.kernel
def slot_densities_kernel(
    tables: Tables,
    table: wp.array(dtype=vec4h),  # [entries]
    nodes: wp.array(dtype=vec4h),  # node_table of the dense levels
    used_level_count: int,  # the finer ones count as zero
    weights: wp.array(dtype=vec4h),  # `fragments` of the density network
    biases: wp.array(dtype=float),
    thread_count: int,
    buffers: Buffers,
):
    shared = share_density(weights, biases)
    state = buffers.state
    stride = state[STRIDE]  # a multiple of 32: a warp's slots are neighbors, and all exist
    n = wp.tid()
    while n < state[TOTAL]:
        used = n / stride < buffers.counts[n % stride]
        if any_of_warp(used):
            if used:
                bary = load_wide(buffers.slots.bary, n)
                tet = buffers.slots.tet[n]
                put_levels(shared, tables, table, nodes, used_level_count, tet, bary)
            density_of_rows(shared, n, buffers.sigma, buffers.h)
        n += thread_count
