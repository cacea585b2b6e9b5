"""Corner orders: no other gives better descendants, and the orientation stays positive."""

from itertools import permutations

import numpy as np
import pytest

from deformrf.core.geometry import A15, EDGES, a15_grid, cell_tets, path_corners
from deformrf.core.geometry.corner_order import best_corner_order
from deformrf.core.geometry.mesh import FACES

ALL_ORDERS = np.array(list(permutations(range(4))))  # [24, 4]
IS_EVEN = np.linalg.det(np.eye(4)[ALL_ORDERS]) > 0


def random_tets(count):
    """Corner positions.  [count, 4, 3]"""
    return np.random.default_rng().normal(size=(count, 4, 3))


def ordered(corners):
    return np.take_along_axis(corners, best_corner_order(corners)[..., None], axis=1)


def edge_lengths_squared(tets):
    ends = tets[..., EDGES, :]
    return ((ends[..., 0, :] - ends[..., 1, :]) ** 2).sum(axis=-1)


def mean_ratio(tets):
    """12 (3 V)^(2/3) / sum of squared edge lengths: 1 if regular, 0 if flat."""
    volumes = np.abs(np.linalg.det(tets[..., 1:, :] - tets[..., :1, :])) / 6.0
    return 12.0 * (3.0 * volumes) ** (2 / 3) / edge_lengths_squared(tets).sum(axis=-1)


def dihedral_angles(tets):
    """Degrees.  [T, 12], each twice"""
    a, b, c = (tets[:, FACES[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals = normals / np.linalg.norm(normals, axis=2, keepdims=True)  # all out or all in
    cosines = np.einsum("tix,tjx->tij", normals, normals)[:, ~np.eye(4, dtype=bool)]
    return 180.0 - np.degrees(np.arccos(cosines))


def descendants(corners, levels=2):
    """All of one generation; the second has every shape.  [T, 8^levels, 4, 3]"""
    return path_corners(levels) @ corners[:, None]


def test_a_regular_tet_has_mean_ratio_1():
    tet = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1]])
    assert mean_ratio(tet) == pytest.approx(1.0)


def test_no_order_is_better_and_an_even_one_is_as_good():
    corners = random_tets(200)
    worst = np.stack(
        [mean_ratio(descendants(corners[:, order])).min(axis=1) for order in ALL_ORDERS]
    )
    chosen = mean_ratio(descendants(ordered(corners))).min(axis=1)
    np.testing.assert_allclose(chosen, worst.max(axis=0), rtol=1e-9)
    np.testing.assert_allclose(worst[IS_EVEN].max(axis=0), worst.max(axis=0), rtol=1e-9)
    assert (chosen > worst[0] - 1e-9).all()  # worst[0] is of the order given


def test_of_orders_with_equal_minimum_the_best_mean_is_chosen():
    """Of the tets with small integer coordinates, the mean decides for about one in 14."""
    corners = np.random.default_rng().integers(0, 4, size=(500, 4, 3))
    corners = corners[np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) > 0.5]

    def quality(tets):
        """Minimum and mean over the three shapes: child 0 has one, 4-7 have two each of two."""
        ratios = mean_ratio(descendants(tets, 1))
        return ratios.min(axis=1), (ratios[:, 0] + ratios[:, 4:].sum(axis=1) / 2) / 3

    worst, mean = np.stack([quality(corners[:, order]) for order in ALL_ORDERS], axis=1)
    best_mean = np.where(worst > worst.max(axis=0) - 1e-9, mean, 0.0).max(axis=0)
    np.testing.assert_allclose(quality(ordered(corners))[1], best_mean, rtol=1e-9)


def test_the_permutation_is_even_and_the_best_order_stays():
    corners = random_tets(500)
    order = best_corner_order(corners)
    assert (np.linalg.det(np.eye(4)[order]) > 0).all()
    assert (order != np.arange(4)).any()
    np.testing.assert_array_equal(best_corner_order(ordered(corners)), [np.arange(4)] * 500)


def test_descendants_of_the_lattice_keep_their_shape():
    """The worst orders would come down to a mean ratio of 0.69 and go up to 127 degrees."""
    tets = cell_tets(A15)
    assert np.linalg.det(tets[:, 1:] - tets[:, :1]).min() > 0
    _, distinct = np.unique(edge_lengths_squared(tets), axis=0, return_index=True)
    for corners in tets[distinct]:
        small = path_corners(5) @ corners
        assert mean_ratio(small).min() > 0.8386
        shapes = np.sort(edge_lengths_squared(small), axis=1)  # integers, so exact
        assert len(np.unique(shapes, axis=0)) <= 3
        angles = dihedral_angles(small)
        assert angles.min() > 46.4
        assert angles.max() < 112.3


def test_the_grids_tets_are_in_their_best_order():
    mesh = a15_grid(0.11)
    order = best_corner_order(mesh.addresses[mesh.tets])
    np.testing.assert_array_equal(order, np.broadcast_to(np.arange(4), order.shape))
