"""Occupancy masks: bits in the right place."""

import numpy as np
import warp as wp

from deformrf.core.definition import networks
from deformrf.core.field import is_occupied, pack_mask, subtet_corners, subtet_of, unpack_mask


def test_packing_is_invertible():
    occupied = np.random.default_rng().uniform(size=(50, 64)) < 0.5
    np.testing.assert_array_equal(unpack_mask(pack_mask(occupied)), occupied)


def test_the_middle_of_subtet_p_asks_for_bit_p():
    middles = subtet_corners().mean(axis=1)
    for p in range(64):
        mask = pack_mask(np.arange(64)[None] == p)
        found = networks.is_occupied(mask, np.zeros(64, int), middles)
        np.testing.assert_array_equal(found, np.arange(64) == p)


@wp.kernel
def occupied_kernel(
    mask: wp.array(dtype=wp.uint64),
    tet: wp.array(dtype=int),
    bary: wp.array(dtype=wp.vec4),
    found: wp.array(dtype=int),
):
    n = wp.tid()
    found[n] = wp.where(is_occupied(mask[tet[n]], subtet_of(bary[n])), 1, 0)


def test_kernel_matches_numpy(device):
    rng = np.random.default_rng()
    mask = pack_mask(rng.uniform(size=(20, 64)) < 0.5)
    tet = rng.integers(0, 20, 3000).astype(np.int32)
    bary = rng.dirichlet(np.ones(4), 3000).astype(np.float32)
    found = wp.empty(3000, dtype=int, device=device)
    wp.launch(
        occupied_kernel,
        dim=3000,
        inputs=[
            wp.array(mask, dtype=wp.uint64, device=device),
            wp.array(tet, dtype=int, device=device),
            wp.array(bary, dtype=wp.vec4, device=device),
        ],
        outputs=[found],
        device=device,
    )
    np.testing.assert_array_equal(found.numpy() == 1, networks.is_occupied(mask, tet, bary))
