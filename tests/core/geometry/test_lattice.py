"""The grids: cells filled, conforming, positively oriented, and they cover the cube.

Corner orders: no other gives better descendants, and the orientation stays positive.
"""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from deformrf.core.geometry import (
    A15,
    BCC,
    EDGES,
    KUHN,
    a15_grid,
    boundary_faces,
    cell_tets,
    edges,
    extract,
    lattice_spacing,
    lattice_vertices,
    morton_order,
    path_corners,
    signed_volumes,
    tet_neighbours,
)
from deformrf.core.geometry.lattice import MARGIN, best_corner_order, grid
from deformrf.core.geometry.mesh import FACES

LATTICES = [A15, BCC, KUHN]
ALL_ORDERS = np.array(list(permutations(range(4))))  # [24, 4]
IS_EVEN = np.linalg.det(np.eye(4)[ALL_ORDERS]) > 0
lattices = pytest.mark.parametrize("lattice", LATTICES, ids=["a15", "bcc", "kuhn"])


@pytest.mark.parametrize(("lattice", "count"), [(A15, 46), (BCC, 12), (KUHN, 6)])
def test_the_tets_of_a_cell_fill_its_volume(lattice, count):
    tets = cell_tets(lattice)
    assert tets.shape == (count, 4, 3)
    corners = tets.reshape(-1, 3).astype(float)
    volumes = signed_volumes(corners, np.arange(4 * count).reshape(count, 4))
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(lattice.cell_edge**3)


@pytest.mark.parametrize(
    ("mesh", "lengths"),
    [(a15_grid(0.1), {4, 5, 6}), (grid(BCC, 0.2), {3, 4}), (grid(KUHN, 0.3), {1, 2, 3})],
)
def test_edges_have_the_lengths_of_their_lattice(mesh, lengths):
    ends = mesh.addresses[mesh.tets][:, EDGES]
    squared = ((ends[:, :, 0] - ends[:, :, 1]) ** 2).sum(axis=-1)
    assert set(np.unique(squared)) == lengths


@pytest.mark.parametrize(
    ("mesh", "in_edges", "in_tets"),
    [
        (a15_grid(0.1), {12, 14}, {20, 24}),
        (grid(BCC, 0.1), {14}, {24}),
        (grid(KUHN, 0.1), {14}, {24}),
    ],
)
def test_inner_vertices_have_the_valence_of_their_lattice(mesh, in_edges, in_tets):
    faces, _ = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
    inner = np.setdiff1d(np.arange(mesh.vertex_count), faces)
    assert set(np.bincount(edges(mesh.tets).ravel())[inner]) == in_edges
    assert set(np.bincount(mesh.tets.ravel())[inner]) == in_tets


def test_no_dihedral_angle_exceeds_78_5_degrees():
    mesh = a15_grid(0.2)
    x = mesh.rest_vertices[mesh.tets]
    normals = np.stack(
        [
            np.cross(x[:, b] - x[:, a], x[:, c] - x[:, a])
            for a, b, c in ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))
        ],
        axis=1,
    )
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    cosines = np.einsum("tix,tjx->tij", normals, normals)[:, ~np.eye(4, dtype=bool)]
    angles = 180.0 - np.degrees(np.arccos(cosines))
    assert angles.max() < 78.6
    assert angles.min() > 50.0


@lattices
@pytest.mark.parametrize("spacing", [0.25, 0.11, 0.05])
def test_the_mesh_is_conforming_and_positively_oriented(lattice, spacing):
    mesh = grid(lattice, spacing)
    volumes = signed_volumes(mesh.rest_vertices, mesh.tets)
    assert volumes.min() > 0
    faces, _ = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
    a, b, c = (mesh.rest_vertices[faces[:, i]] for i in range(3))
    enclosed = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert enclosed == pytest.approx(volumes.sum(), rel=1e-9)  # no gap, no overlap


@lattices
def test_every_point_of_the_cube_lies_in_a_tet(lattice):
    mesh = grid(lattice, 0.2)
    points = np.random.default_rng().uniform(size=(2000, 3))
    points[:8] = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T  # the corners
    x = mesh.rest_vertices[mesh.tets]
    inverse = np.linalg.inv(np.swapaxes(x[:, 1:] - x[:, :1], 1, 2))
    local = np.einsum("tij,ptj->pti", inverse, points[:, None] - x[None, :, 0])
    inside = (local >= -1e-9).all(axis=2) & (local.sum(axis=2) <= 1 + 1e-9)
    assert inside.any(axis=1).all()


def test_the_papers_spacing_gives_about_the_papers_grid():
    """QuarTet cuts the grid at the cube's faces (17,933 and 92,234); ours is uncut."""
    mesh = a15_grid(0.02)
    assert (mesh.vertex_count, mesh.tet_count) == (18083, 92675)
    np.testing.assert_allclose(mesh.rest_vertices, (mesh.addresses - MARGIN) * 0.02, atol=1e-12)
    assert mesh.addresses.min() >= 0


@pytest.mark.parametrize("spacing", [0.0, -0.1, 0.3])
def test_a_wrong_spacing_is_named(spacing):
    with pytest.raises(ValueError, match=str(spacing)):
        a15_grid(spacing)
    with pytest.raises(ValueError, match=r"1.1; give a number in \(0, 1.0\]"):
        grid(KUHN, 1.1)


def test_morton_order_keeps_octants_together():
    points = np.random.default_rng().integers(0, 64, (500, 3))
    octant = (points >= 32) @ [1, 2, 4]
    assert (np.diff(octant[morton_order(points)]) >= 0).all()


@lattices
def test_the_spacing_of_any_part_of_a_lattice_gives_its_vertices_exactly(lattice):
    rng = np.random.default_rng()
    mesh = grid(lattice, rng.uniform(0.07, 0.25))
    part, _ = extract(mesh, rng.random(mesh.tet_count) < 0.1)
    spacing = lattice_spacing(part)
    np.testing.assert_array_equal(lattice_vertices(part.addresses, spacing), part.rest_vertices)


def test_a_mesh_whose_vertices_moved_has_no_spacing():
    mesh = a15_grid(0.2)
    vertices = mesh.rest_vertices.copy()
    index = np.unravel_index(np.abs(vertices).argmax(), vertices.shape)
    vertices[index] = np.nextafter(vertices[index], 2.0)
    assert lattice_spacing(replace(mesh, rest_vertices=vertices)) is None
    assert lattice_spacing(replace(mesh, rest_vertices=mesh.rest_vertices + 0.1)) is None


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
