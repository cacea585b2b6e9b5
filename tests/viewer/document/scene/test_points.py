"""Control points: where they are, and that they are spread evenly."""

import numpy as np
import pytest

from deformrf.viewer.document import ControlPoints, Motion, rotation_matrix
from deformrf.viewer.document.scene.points import (
    SPACING,
    located,
    of_large_clusters,
    placed,
    spread,
)


def test_a_point_is_found_in_its_tet_and_goes_where_the_tet_goes(ball):
    """An affine map of the mesh maps each point as it maps any other."""
    random = np.random.default_rng(0)
    mesh = ball.mesh
    inside = np.einsum(
        "nk,nkx->nx", random.dirichlet(np.ones(4), 20), mesh.rest_vertices[mesh.tets[:20]]
    )
    points = located(inside, mesh.rest_vertices, mesh.tets)
    np.testing.assert_allclose(points.at(mesh.rest_vertices), inside, atol=1e-6)
    matrix, offset = random.normal(size=(3, 3)), random.normal(size=3)
    moved = points.at(mesh.rest_vertices @ matrix.T + offset)
    np.testing.assert_allclose(moved, inside @ matrix.T + offset, atol=1e-5)


def test_a_point_outside_is_moved_into_the_nearest_tet_and_flat_tets_hold_none():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0.0]])
    tets = np.array([[0, 1, 2, 3], [0, 1, 4, 1]])
    points = located([[-0.1, 0.25, 0.25], [1.5, 0.0, 0.0]], vertices, tets)
    assert points.corners.tolist() == [[0, 1, 2, 3]] * 2
    assert points.weights.min() >= 0.0 and points.weights.sum(axis=1) == pytest.approx(1.0)
    assert points.at(vertices)[1] == pytest.approx([1.0, 0.0, 0.0])


def test_points_are_spread_and_fill_the_surface():
    random = np.random.default_rng(1)
    surface = random.normal(size=(2000, 3))
    surface /= np.linalg.norm(surface, axis=1, keepdims=True)
    chosen = surface[spread(surface, 0.5, 1000)]
    apart = np.linalg.norm(chosen[:, None] - chosen, axis=2)
    assert apart[~np.eye(len(chosen), dtype=bool)].min() >= 0.5
    gaps = np.linalg.norm(surface[:, None] - chosen, axis=2).min(axis=1)
    assert gaps.max() < 0.5  # nowhere is room for one more
    assert len(spread(surface, 0.0, 7)) == 7


def test_a_speck_in_the_air_gets_no_point_and_few_points_lose_none():
    random = np.random.default_rng()
    surface = random.uniform(0, 1, (2000, 3)) * [1.0, 1.0, 0.0]
    speck = np.array([[0.5, 0.5, 0.6], [0.5, 0.5, 0.61]])
    kept = of_large_clusters(np.concatenate([surface, speck]), 0.06)
    assert kept[:-2].mean() > 0.99 and not kept[-2:].any()
    assert of_large_clusters(surface[:4], 0.06).all()


def test_rows_of_a_session_have_every_digit(ball):
    mesh = ball.mesh
    points = placed(mesh.rest_vertices, mesh.rest_vertices, mesh.tets, 0.6)
    again = ControlPoints.of_rows(points.rows())
    np.testing.assert_array_equal(again.corners, points.corners)
    np.testing.assert_array_equal(again.weights, points.weights)
    at = points.at(mesh.rest_vertices)
    apart = np.linalg.norm(at[:, None] - at, axis=2)[~np.eye(len(at), dtype=bool)]
    assert apart.min() >= 0.99 * SPACING * 0.6


def test_a_motion_that_is_undone_gives_the_offsets_that_were_applied():
    random = np.random.default_rng(2)
    offsets = random.normal(size=(7, 3))
    motion = Motion(random.normal(size=3), random.normal(size=3))
    for one in (motion, motion.turned(random.normal(size=3), 1.7)):
        np.testing.assert_allclose(one.undone(one.applied(offsets)), offsets, atol=1e-12)
    turned = motion.turned([0.0, 0.0, np.pi / 2], 2.0)
    center = motion.place + motion.center
    expected = center + 2.0 * np.cross([0, 0, 1.0], offsets - motion.center)
    expected[:, 2] = (center + 2.0 * (offsets - motion.center))[:, 2]
    np.testing.assert_allclose(turned.applied(offsets), expected, atol=1e-12)


def test_rotations_are_rotations():
    matrix = rotation_matrix(np.random.default_rng(3).normal(size=3))
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    np.testing.assert_array_equal(rotation_matrix(np.zeros(3)), np.eye(3))
