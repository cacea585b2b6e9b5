"""What follows from connectivity: neighbours, boundary, edges, components, solids, sub-meshes."""

import numpy as np
import pytest

from deformrf.core.geometry import (
    a15_grid,
    boundary_faces,
    components,
    edges,
    extract,
    face_components,
    fill_enclosed,
    signed_volumes,
    tet_neighbours,
)
from deformrf.core.geometry.mesh import FACES


@pytest.fixture(scope="module")
def mesh():
    return a15_grid(0.15)


def test_neighbours_share_the_face_and_know_each_other(mesh):
    neighbours = tet_neighbours(mesh.tets)
    for tet, face in zip(*np.nonzero(neighbours >= 0), strict=True):
        other = neighbours[tet, face]
        shared = set(mesh.tets[tet, FACES[face]])
        assert shared < set(mesh.tets[other])
        assert tet in neighbours[other]


def test_a_face_of_three_tets_is_refused():
    with pytest.raises(ValueError, match="manifold"):
        tet_neighbours(np.array([[0, 1, 2, 3], [0, 1, 2, 4], [0, 1, 2, 5]]))


def test_boundary_normals_point_outwards(mesh):
    faces, tets = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
    a, b, c = (mesh.rest_vertices[faces[:, i]] for i in range(3))
    inner = mesh.rest_vertices[mesh.tets[tets]].mean(axis=1)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), inner - a) < 0).all()


def test_eulers_formula_holds_for_a_ball(mesh):
    neighbours = tet_neighbours(mesh.tets)
    face_count = (4 * mesh.tet_count + (neighbours < 0).sum()) // 2
    assert mesh.vertex_count - len(edges(mesh.tets)) + face_count - mesh.tet_count == 1


def test_components_are_what_tets_join(mesh):
    middles = mesh.rest_vertices[mesh.tets].mean(axis=1)
    apart, _ = extract(mesh, np.abs(middles[:, 0] - 0.5) > 0.25)
    labels = components(apart.vertex_count, apart.tets)
    assert set(labels) == {0, 1}
    assert (labels[apart.tets] == labels[apart.tets[:, :1]]).all()
    left = apart.rest_vertices[:, 0] < 0.5
    assert len(set(labels[left])) == len(set(labels[~left])) == 1


def test_extract_keeps_shape_and_addresses(mesh):
    keep = np.random.default_rng().uniform(size=mesh.tet_count) < 0.3
    part, old_ids = extract(mesh, keep)
    np.testing.assert_array_equal(old_ids[part.tets], mesh.tets[keep])
    np.testing.assert_array_equal(part.addresses, mesh.addresses[old_ids])
    assert set(part.tets.ravel()) == set(range(part.vertex_count))


def test_volume_changes_sign_under_reflection(mesh):
    volumes = signed_volumes(mesh.rest_vertices, mesh.tets)
    np.testing.assert_allclose(signed_volumes(mesh.rest_vertices * [1, 1, -1], mesh.tets), -volumes)


def test_face_components_part_at_hinges():
    """Two tets that share an edge are one vertex component and two face components."""
    tets = np.array([[0, 1, 2, 3], [0, 1, 4, 5], [1, 2, 3, 6]])
    labels = face_components(tet_neighbours(tets))
    assert labels[0] == labels[2] != labels[1]
    assert set(components(7, tets)) == {0}
    labels = face_components(tet_neighbours(tets), np.array([True, True, False]))
    assert labels.tolist() == [0, 1, -1]


def test_components_are_those_of_scipy():
    """Against scipy.sparse.csgraph, on random parts of a grid."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    rng = np.random.default_rng()
    grid = a15_grid(0.1)
    neighbours = tet_neighbours(grid.tets)
    for share in (0.1, 0.5, 0.9):
        keep = rng.uniform(size=grid.tet_count) < share
        tet, face = np.nonzero((neighbours >= 0) & keep[neighbours] & keep[:, None])
        links = coo_array((np.ones(len(tet)), (tet, neighbours[tet, face])), (len(keep),) * 2)
        _, expected = connected_components(links)
        labels = face_components(neighbours, keep)
        assert (labels[~keep] == -1).all()
        pairs = np.unique(np.stack([labels[keep], expected[keep]]), axis=1)
        assert pairs.shape[1] == len(np.unique(pairs[0])) == len(np.unique(pairs[1]))


def test_a_hollow_ball_is_filled_and_a_bowl_is_not():
    mesh = a15_grid(0.05)
    neighbours = tet_neighbours(mesh.tets)
    middles = mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5
    radius = np.linalg.norm(middles, axis=1)
    shell = (radius > 0.25) & (radius < 0.4)
    filled = fill_enclosed(shell, neighbours)
    np.testing.assert_array_equal(filled, radius < 0.4)
    bowl = shell & (middles[:, 2] < 0.1)
    np.testing.assert_array_equal(fill_enclosed(bowl, neighbours), bowl)
    lid = middles[:, 2] >= 0.1  # it closes the bowl, and isn't added
    inside = (radius < 0.4) & ~lid
    np.testing.assert_array_equal(fill_enclosed(bowl, neighbours, lid), inside)
