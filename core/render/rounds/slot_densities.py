"""Slots to density and h on CUDA, where rays have colors: encode and the density network at once.

`encode_slots_kernel` and the networks' kernel do the same in two launches, and write the features
to memory between them, 56 bytes for each slot.
"""

import warp as wp

from ...field import Tables, any_of_warp, density_of_rows, density_room, encoded_half, put_features
from ...geometry import lattice_point
from ...wide import load_wide, vec4h
from .slots import BLOCK_SIZE, STRIDE, TOTAL, Buffers

BLOCKS_PER_PROCESSOR = 7  # the registers have room for no more

wp.set_module_options(
    {"enable_backward": False, "max_unroll": 2, "fast_math": True, "block_dim": BLOCK_SIZE}
)


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
    room = density_room(weights, biases)
    state = buffers.state
    stride = state[STRIDE]  # a multiple of 32: a warp's slots are neighbors, and all exist
    n = wp.tid()
    while n < state[TOTAL]:
        used = n / stride < buffers.counts[n % stride]
        if any_of_warp(used):
            if used:
                tet = buffers.slots.tet[n]
                x = lattice_point(load_wide(buffers.slots.bary, n))
                products = tables.products[tet]
                level = int(0)
                while level < used_level_count:
                    put_features(
                        room, level, encoded_half(tables, table, nodes, level, tet, x, products)
                    )
                    level += 1
            density_of_rows(room, n, buffers.sigma, buffers.h)
        n += thread_count
