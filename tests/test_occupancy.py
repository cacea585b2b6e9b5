"""Occupancy masks: bits in the right place, and solids without caves."""

import numpy as np
import warp as wp

from deformrf.core.field import LEVELS, fill_enclosed, is_occupied, is_occupied_reference, subtet_of
from deformrf.core.field.occupancy import pack_mask, unpack_mask
from deformrf.core.geometry import a15_grid, path_corners, tet_neighbours


def test_packing_is_invertible():
    occupied = np.random.default_rng().uniform(size=(50, 64)) < 0.5
    np.testing.assert_array_equal(unpack_mask(pack_mask(occupied)), occupied)


def test_the_middle_of_subtet_p_asks_for_bit_p():
    middles = path_corners(LEVELS).mean(axis=1) / 2**LEVELS
    for p in range(64):
        mask = pack_mask(np.arange(64)[None] == p)
        found = is_occupied_reference(mask, np.zeros(64, int), middles)
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
    np.testing.assert_array_equal(found.numpy() == 1, is_occupied_reference(mask, tet, bary))


def test_a_hollow_ball_is_filled_and_a_bowl_is_not():
    mesh = a15_grid(0.05)
    neighbours = tet_neighbours(mesh.tets)
    middles = mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5
    radius = np.linalg.norm(middles, axis=1)
    shell = (radius > 0.25) & (radius < 0.4)
    filled = fill_enclosed(shell, neighbours)
    np.testing.assert_array_equal(filled, radius < 0.4)
    bowl = shell & (middles[:, 2] < 0.1)
    np.testing.assert_array_equal(fill_enclosed(bowl, neighbours), bowl)
