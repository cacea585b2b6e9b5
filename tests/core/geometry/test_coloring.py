"""Colors: no two constraints of one color share a vertex, and none is lost.

Lattices are found again in a trimmed, scaled, shifted mesh.
"""

from itertools import pairwise

import numpy as np
import pytest
from color_search import few_colors, sites

from deformrf.core.geometry import (
    A15,
    BCC,
    KUHN,
    color_order,
    edges,
    extract,
    lattice_addresses,
)
from deformrf.core.geometry.coloring import (
    _table,
    complete_colors,
    periodic_classes,
)
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


@pytest.mark.parametrize("vertex_count", [2, 4])
@pytest.mark.parametrize("lattice", [A15, BCC, KUHN])
def test_known_colors_are_as_few_as_the_search_finds(lattice, vertex_count):
    keys, constraints = sites(lattice, vertex_count)
    known_keys, known = _table(lattice, vertex_count)
    np.testing.assert_array_equal(keys, known_keys)
    assert len(known) == len(keys)
    assert len(np.unique(known)) == len(np.unique(few_colors(constraints)))
    for color in np.unique(known):
        touched = constraints[known == color].ravel()
        assert len(np.unique(touched)) == len(touched)


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


@pytest.mark.parametrize("lattice", [A15, BCC, KUHN])
def test_a_part_of_a_lattice_is_recognized(lattice):
    random = np.random.default_rng()
    mesh = grid(lattice, 0.08)
    far = np.linalg.norm(mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5, axis=1)
    mesh, _ = extract(mesh, (far < 0.4) & (random.uniform(size=len(far)) < 0.8))
    scale, shift = random.uniform(0.1, 10.0), random.uniform(-5.0, 5.0, 3)
    moved = (scale * mesh.rest_vertices + shift).astype(np.float32).astype(np.float64)
    found, addresses, on_lattice = lattice_addresses(moved)
    assert found is lattice
    assert on_lattice.all()
    # The same as the grid's own, but for a whole number of cells and a symmetry of them.
    differences = np.diff(mesh.addresses.astype(int), axis=0)
    np.testing.assert_array_equal(np.diff(addresses, axis=0), differences)


def test_other_meshes_have_no_lattice():
    random = np.random.default_rng()
    assert lattice_addresses(random.uniform(size=(300, 3))) is None
    assert lattice_addresses(np.zeros((4, 3))) is None
    corners = np.array([[-0.3, -0.3, 0.2], [0.3, -0.3, 0.2], [0.0, 0.4, 0.2], [0, 0, 0.71]])
    assert lattice_addresses(corners) is None


@pytest.mark.parametrize("lattice", [A15, BCC, KUHN])
def test_translates_have_one_class_and_color(lattice):
    mesh = grid(lattice, 0.08)
    corners = mesh.addresses[mesh.tets].astype(np.int64)
    colors, classes = periodic_classes(lattice, corners)
    assert (colors >= 0).all()
    cells = np.random.default_rng().integers(-3, 4, 3)
    moved = periodic_classes(lattice, corners + 4 * cells)  # 4: a period of each of them
    np.testing.assert_array_equal(moved[0], colors)
    np.testing.assert_array_equal(moved[1], classes)
    pairs = np.unique(np.stack([classes, colors], axis=1), axis=0)
    assert len(pairs) == len(np.unique(classes))


def test_what_is_not_of_the_lattice_has_none():
    corners = np.array([[[0, 0, 0], [4, 0, 0]], [[0, 0, 0], [1, 2, 0]]])
    colors, classes = periodic_classes(A15, corners)
    assert colors[0] == classes[0] == -1
    assert colors[1] >= 0 and classes[1] >= 0
