"""The surface for contact: samples, bevels, the exits of each tet."""

import numpy as np

from deformrf.core.deform.contact import surface as module
from deformrf.core.deform.contact.clusters import make_clusters
from deformrf.core.geometry import a15_grid, components, extract


def two_balls():
    mesh = a15_grid(0.05)
    middles = mesh.rest_vertices[mesh.tets].mean(axis=1)
    away = [np.linalg.norm(middles - c, axis=1) for c in ([0.25] * 3, [0.7] * 3)]
    return extract(mesh, (away[0] < 0.2) | (away[1] < 0.28))[0]


BALLS = two_balls()
CLUSTERS = make_clusters(BALLS.rest_vertices, BALLS.tets, 0.02)
SURFACE = module.make_surface(BALLS.rest_vertices, BALLS.tets, CLUSTERS)


def test_samples_are_the_vertices_and_the_middles_of_edges_of_the_surface():
    at_vertices = SURFACE.shares == 0.0
    assert np.array_equal(np.sort(SURFACE.ends[at_vertices, 0]), np.unique(SURFACE.faces))
    assert (SURFACE.ends[at_vertices, 0] == SURFACE.ends[at_vertices, 1]).all()
    assert (SURFACE.shares[~at_vertices] == 0.5).all()
    assert (~at_vertices).sum() == 3 * len(SURFACE.faces) / 2  # each edge has two faces


def test_faces_are_listed_with_their_leaves():
    leaf = np.searchsorted(CLUSTERS.tet_offsets, SURFACE.face_tets, side="right") - 1
    listed = np.repeat(np.arange(len(CLUSTERS.tet_offsets) - 1), np.diff(SURFACE.face_offsets))
    assert np.array_equal(leaf, listed)
    corners = np.concatenate([SURFACE.faces, SURFACE.opposite[:, None]], axis=1)
    assert np.array_equal(np.sort(corners), np.sort(SURFACE.tets[SURFACE.face_tets]))


def brute_distance(point, faces, vertices):
    """To each face, by the least of many points on it."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    weights = module.closest_weights(point - a, b - a, c - a)
    nearest = weights[:, :1] * a + weights[:, 1:2] * b + weights[:, 2:] * c
    return np.linalg.norm(point - nearest, axis=1)


def test_closest_weights_beat_every_other_point_of_a_triangle():
    random = np.random.default_rng()
    triangles, points = random.normal(size=(200, 3, 3)), 2.0 * random.normal(size=(200, 3))
    a, b, c = (triangles[:, i] for i in range(3))
    weights = module.closest_weights(points - a, b - a, c - a)
    assert weights.min() >= 0.0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    nearest = np.einsum("nk,nkj->nj", weights, triangles)
    others = np.einsum("mk,nkj->nmj", random.dirichlet([0.7] * 3, 500), triangles)
    best = np.linalg.norm(points[:, None] - others, axis=-1).min(axis=1)
    found = np.linalg.norm(points - nearest, axis=1)
    assert (found <= best + 1e-9).all()
    assert np.median(best - found) < 0.02


def test_the_best_exit_is_nearly_the_nearest_face_of_the_component():
    exits = module.exits(BALLS.rest_vertices, SURFACE)
    random, x = np.random.default_rng(), BALLS.rest_vertices
    of_vertex = components(len(x), BALLS.tets)
    ratios = []
    for tet in random.integers(len(SURFACE.tets), size=300):
        point = random.dirichlet([1.0] * 4) @ x[SURFACE.tets[tet]]
        own = SURFACE.faces[of_vertex[SURFACE.faces[:, 0]] == of_vertex[SURFACE.tets[tet, 0]]]
        mine = SURFACE.faces[exits[tet][exits[tet] >= 0]]
        assert (of_vertex[mine[:, 0]] == of_vertex[SURFACE.tets[tet, 0]]).all()
        best = brute_distance(point, own, x).min()
        ratios.append(brute_distance(point, mine, x).min() / best)
    assert np.mean(np.array(ratios) < 1.0 + 1e-9) > 0.9
    assert max(ratios) < 1.6  # 1.49 among 20,000 points


def test_bevels_are_those_of_convex_flat_and_concave_edges():
    """Two triangles that share the edge from 0 to 1, at an angle."""
    for angle in np.radians([-60.0, 0.0, 60.0, 90.0]):  # how far the second turns down
        vertices = np.array(
            [[0, 0, 0], [2.0, 0, 0], [0, 1, 0], [0, -np.cos(angle), -np.sin(angle)]]
        )
        found, rims, tops = module.bevels(vertices, np.array([[0, 1, 2], [1, 0, 3]]))
        shared = found[0, 2], found[1, 2]  # opposite the third corners
        assert (rims[0, 2] > 0.0) == (angle > 0.5)
        assert (tops < 1.0).tolist()[0][:2] == [True, True]  # all other edges are sharp
        np.testing.assert_allclose(shared, 2.0 * np.tan(angle / 2.0), atol=1e-12)
