"""Colors: no two constraints of one color share a vertex, and none is lost."""

from itertools import pairwise

import numpy as np
import pytest

from deformrf.core.geometry import A15, BCC, KUHN, color_order, edges, extract
from deformrf.core.geometry.coloring import complete_colors
from deformrf.core.geometry.lattice import grid


def part_of(lattice, spacing, share=0.5):
    """A random part of a grid, with ragged ends."""
    mesh = grid(lattice, spacing)
    near = np.linalg.norm(mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5, axis=1) < share
    keep = near & (np.random.default_rng().uniform(size=len(near)) < 0.9)
    return extract(mesh, keep)[0]


def greedy_colors(constraints, vertex_count):
    return complete_colors(constraints, np.full(len(constraints), -1), vertex_count)


def assert_partition(constraints, order, offsets):
    assert sorted(order.tolist()) == list(range(len(constraints)))
    for first, last in pairwise(offsets):
        vertices = constraints[order[first:last]]
        assert len(vertices) > 0
        assert len(np.unique(vertices)) == vertices.size


@pytest.mark.parametrize("lattice", [A15, BCC, KUHN])
def test_constraints_of_one_color_share_no_vertex(lattice):
    mesh = part_of(lattice, 0.08)
    for constraints in (edges(mesh.tets), mesh.tets):
        assert_partition(constraints, *color_order(constraints, mesh.rest_vertices)[:2])
        colors = greedy_colors(constraints, mesh.vertex_count)
        assert_partition(
            constraints, np.argsort(colors), np.append(0, np.bincount(colors).cumsum())
        )


@pytest.mark.parametrize("lattice, edge_colors, tet_colors", [(A15, 14, 26), (BCC, 14, 24)])
def test_a_lattice_needs_about_as_many_colors_as_a_vertex_has_constraints(
    lattice, edge_colors, tet_colors
):
    mesh = part_of(lattice, 0.07)
    for constraints, expected in ((edges(mesh.tets), edge_colors), (mesh.tets, tet_colors)):
        _, offsets, _ = color_order(constraints, mesh.rest_vertices)
        assert len(offsets) - 1 <= expected


def test_a_mesh_of_no_lattice_and_braces_are_colored_greedily():
    mesh = part_of(A15, 0.1)
    random = np.random.default_rng()
    shaken = mesh.rest_vertices + random.normal(scale=0.01, size=mesh.rest_vertices.shape)
    assert_partition(mesh.tets, *color_order(mesh.tets, shaken)[:2])
    braces = np.sort(random.permutation(mesh.vertex_count)[:40].reshape(-1, 2), axis=1)
    constraints = np.unique(np.concatenate([edges(mesh.tets), braces]), axis=0)
    assert_partition(constraints, *color_order(constraints, mesh.rest_vertices)[:2])


def test_vertices_at_one_place_are_told_apart():
    mesh = part_of(A15, 0.1)
    middle = mesh.rest_vertices[:, 0] > 0.5  # tets on both sides of a cut have own vertices
    right = middle[mesh.tets].all(axis=1)
    tets = mesh.tets.copy()
    tets[right] += mesh.vertex_count * (mesh.rest_vertices[mesh.tets[right], 0] < 0.6)
    vertices = np.concatenate([mesh.rest_vertices, mesh.rest_vertices])
    assert_partition(tets, *color_order(tets, vertices)[:2])


def test_a_vertex_has_as_many_colors_as_edges():
    star = np.array([[0, i] for i in range(1, 9)])
    assert greedy_colors(star, 9).tolist() == list(range(8))


def test_separate_constraints_have_one_color():
    assert greedy_colors(np.arange(12).reshape(3, 4), 12).tolist() == [0, 0, 0]


def test_given_colors_stay():
    path = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])
    assert complete_colors(path, np.array([-1, 0, -1, 5]), 5).tolist() == [1, 0, 1, 5]


def test_within_a_color_the_given_order_stays():
    order, offsets, classes = color_order(
        np.array([[0, 1], [1, 2], [2, 3], [4, 5]]), np.zeros((6, 3))
    )
    assert order.tolist() == [0, 2, 3, 1]
    assert offsets.tolist() == [0, 3, 4]
    assert (classes == -1).all()
