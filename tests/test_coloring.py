"""Colors: no two constraints of one color share a vertex, and none is lost."""

import numpy as np

from deformrf.core.geometry.coloring import greedy_colors, sort_by_color
from deformrf.core.geometry.lattice import a15_grid
from deformrf.core.geometry.mesh import edges


def test_constraints_of_one_color_share_no_vertex():
    mesh = a15_grid(0.1)
    for constraints in (edges(mesh.tets), mesh.tets):
        colors = greedy_colors(constraints, mesh.vertex_count)
        for color in range(colors.max() + 1):
            vertices = constraints[colors == color]
            assert len(vertices) > 0
            assert len(np.unique(vertices)) == vertices.size


def test_a_vertex_has_as_many_colors_as_edges():
    star = np.array([[0, i] for i in range(1, 9)])
    assert greedy_colors(star, 9).tolist() == list(range(8))


def test_separate_constraints_have_one_color():
    assert greedy_colors(np.arange(12).reshape(3, 4), 12).tolist() == [0, 0, 0]


def test_sorting_groups_colors_and_keeps_the_order_within():
    order, offsets = sort_by_color(np.array([1, 0, 2, 1, 0]))
    assert order.tolist() == [1, 4, 0, 3, 2]
    assert offsets.tolist() == [0, 2, 4, 5]
