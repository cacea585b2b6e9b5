"""Braces: hinges at an edge or a vertex get them, other meshes don't."""

import numpy as np

from deformrf.core.deform.bracing import hinge_braces
from deformrf.core.geometry import a15_grid, face_components, tet_neighbours


def test_a_grid_needs_no_braces():
    tets = a15_grid(0.1).tets
    assert (face_components(tet_neighbours(tets)) == 0).all()
    assert len(hinge_braces(tets)) == 0


def test_tets_that_share_a_face_need_no_braces():
    assert len(hinge_braces(np.array([[0, 1, 2, 3], [1, 2, 3, 4]]))) == 0


def test_separate_tets_are_not_braced():
    tets = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])
    assert len(np.unique(face_components(tet_neighbours(tets)))) == 2
    assert len(hinge_braces(tets)) == 0


def test_a_hinge_at_an_edge_is_braced():
    braces = hinge_braces(np.array([[0, 1, 2, 3], [0, 1, 4, 5]]))
    assert braces.tolist() == [[2, 4], [2, 5], [3, 4], [3, 5]]


def test_a_hinge_at_a_vertex_is_braced():
    braces = hinge_braces(np.array([[0, 1, 2, 3], [0, 4, 5, 6]]))
    assert braces.tolist() == [[a, b] for a in (1, 2, 3) for b in (4, 5, 6)]
