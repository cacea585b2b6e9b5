"""Clusters: a partition of the tets, and who may collide with whom."""

import numpy as np
import pytest

from deformrf.core.deform.contact.clusters import (
    MOST_COMPONENTS,
    TETS_PER_LEAF,
    barycentric,
    make_clusters,
)
from deformrf.core.geometry import a15_grid, components, extract

MARGIN = 0.03


def arch():
    """Two pillars on a base: parts of one component with a gap between them."""
    mesh = a15_grid(0.05)
    x, _, z = mesh.rest_vertices[mesh.tets].mean(axis=1).T
    return extract(mesh, (z < 0.2) | (np.abs(x - 0.5) > 0.2))[0]


ARCH = arch()
CLUSTERS = make_clusters(ARCH.rest_vertices, ARCH.tets, MARGIN)


def members(values, offsets, group):
    return values[offsets[group] : offsets[group + 1]]


def tets_of(clusters, group):
    leaves = clusters.leaf_offsets[group : group + 2]
    return clusters.tets[slice(*clusters.tet_offsets[leaves])]


def side_by_side(away):
    """A body twice, the second one moved."""
    mesh = a15_grid(0.2)
    vertices = np.concatenate([mesh.rest_vertices, mesh.rest_vertices + away])
    return vertices, np.concatenate([mesh.tets, mesh.tets + mesh.vertex_count])


def test_each_tet_is_in_one_leaf_of_a_few():
    assert np.array_equal(np.sort(CLUSTERS.tets), np.arange(ARCH.tet_count))
    assert np.diff(CLUSTERS.tet_offsets).max() <= TETS_PER_LEAF
    assert np.diff(CLUSTERS.tet_offsets).min() > 0


def test_a_cluster_is_connected_and_lists_its_vertices():
    for group in range(len(CLUSTERS.leaf_offsets) - 1):
        tets = ARCH.tets[tets_of(CLUSTERS, group)]
        vertices = members(CLUSTERS.vertices, CLUSTERS.vertex_offsets, group)
        assert np.array_equal(np.unique(tets), vertices)
        assert len(np.unique(components(ARCH.vertex_count, tets)[vertices])) == 1


def test_neighbors_are_no_partners_and_what_is_apart_is():
    count = len(CLUSTERS.leaf_offsets) - 1
    may = CLUSTERS.partners == 1
    assert np.array_equal(may, may.T)
    corners = [members(CLUSTERS.vertices, CLUSTERS.vertex_offsets, g) for g in range(count)]
    x = ARCH.rest_vertices
    for i in range(count):
        for j in range(count):
            gap = np.maximum(
                x[corners[i]].min(axis=0) - x[corners[j]].max(axis=0),
                x[corners[j]].min(axis=0) - x[corners[i]].max(axis=0),
            ).max()
            assert may[i, j] == (gap > MARGIN)
            assert not (may[i, j] and np.isin(corners[i], corners[j]).any())
    pillars = [np.array([x[c].min(axis=0)[2] > 0.3 for c in corners])]
    left = pillars[0] & np.array([x[c].mean(axis=0)[0] < 0.5 for c in corners])
    right = pillars[0] & ~left
    assert left.any() and may[np.ix_(left, right)].all()


@pytest.mark.parametrize("away", [(1.3, 0, 0), (0.5, 0.03, 0.02)])
def test_components_collide_unless_they_go_through_each_other(away):
    vertices, tets = side_by_side(away)
    clusters = make_clusters(vertices, tets, MARGIN)
    boxes = []
    for group in range(len(clusters.leaf_offsets) - 1):
        x = vertices[members(clusters.vertices, clusters.vertex_offsets, group)]
        boxes.append((tets_of(clusters, group)[0] < len(tets) / 2, x.min(axis=0), x.max(axis=0)))
    excluded = 0
    for group, (first, lower, upper) in enumerate(boxes):
        for other, (also_first, low, high) in enumerate(boxes):
            if first != also_first and not clusters.partners[group, other]:
                excluded += 1
                assert (lower < high).all() and (low < upper).all()
    assert (excluded > 0) == (away[0] < 1.0)


def test_the_smallest_of_too_many_components_take_no_part():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    count = MOST_COMPONENTS + 5
    vertices = (corners + 3.0 * np.arange(count)[:, None, None]).reshape(-1, 3)
    clusters = make_clusters(vertices, np.arange(4 * count).reshape(-1, 4), MARGIN)
    assert len(clusters.tets) == MOST_COMPONENTS


def test_barycentric_coordinates_reproduce_points():
    random = np.random.default_rng()
    corners = random.normal(size=(5, 4, 3))
    points = random.normal(size=(7, 3))
    found = barycentric(points, corners)
    np.testing.assert_allclose(found.sum(axis=-1), 1.0)
    np.testing.assert_allclose(
        np.einsum("ptk,tkj->ptj", found, corners), np.repeat(points[:, None], 5, axis=1), atol=1e-8
    )
