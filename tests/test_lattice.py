"""The grids: cells filled, conforming, positively oriented, and they cover the cube."""

from dataclasses import replace

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
    signed_volumes,
    tet_neighbours,
)
from deformrf.core.geometry.lattice import MARGIN, grid, morton_order

LATTICES = [A15, BCC, KUHN]
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
