"""Surfaces that tets carry."""

import numpy as np
import pytest

from deformrf.core.geometry import EmbeddedSurface, a15_grid, located, tet_neighbours


@pytest.fixture(scope="module")
def mesh():
    return a15_grid(0.25)


def test_a_walk_finds_the_tet_that_holds_a_point(mesh):
    random = np.random.default_rng()
    tets = random.integers(0, mesh.tet_count, 200)
    weights = random.dirichlet(np.ones(4), 200)
    points = np.einsum("nk,nkx->nx", weights, mesh.rest_vertices[mesh.tets[tets]])
    found, again = located(mesh, tet_neighbours(mesh.tets), np.zeros(200, int), points)
    assert (again > -1e-9).all()
    back = np.einsum("nk,nkx->nx", again, mesh.rest_vertices[mesh.tets[found]])
    np.testing.assert_allclose(back, points, atol=1e-9)


def test_a_point_beside_the_mesh_keeps_its_place(mesh):
    points = mesh.rest_vertices.max(axis=0)[None] + 0.1
    found, weights = located(mesh, tet_neighbours(mesh.tets), [0], points)
    assert weights.min() < 0.0 and weights.sum() == pytest.approx(1.0)
    corners = mesh.rest_vertices[mesh.tets[found[0]]]
    np.testing.assert_allclose(weights[0] @ corners, points[0], atol=1e-9)


def test_points_follow_an_affine_motion_of_the_mesh(mesh):
    random = np.random.default_rng()
    tets = random.integers(0, mesh.tet_count, 50)
    weights = random.dirichlet(np.ones(4), 50).astype(np.float32)
    surface = EmbeddedSurface(
        mesh.tets[tets], weights, np.zeros((0, 3), np.int32), np.zeros((50, 3), np.uint8)
    )
    matrix, shift = random.normal(size=(3, 3)), random.normal(size=3)
    moved = surface.points(mesh.rest_vertices @ matrix.T + shift)
    expected = surface.points(mesh.rest_vertices) @ matrix.T + shift
    np.testing.assert_allclose(moved, expected, atol=1e-5)
