"""What counts as a tangle: inverted tets, and edges around which tets wrap twice."""

import numpy as np
import pytest
import warp as wp

from deformrf.core.deform import tangles
from deformrf.core.geometry import a15_grid, signed_volumes


def wheel(tet_count, turns):
    """Tets around the z axis that go around it so often.  Rest [V, 3], current, tets."""
    angles = np.arange(tet_count) * 2.0 * np.pi / tet_count
    axis = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

    def rim(factor):
        return np.stack([np.cos(factor * angles), np.sin(factor * angles), 0.5 + 0 * angles], 1)

    ids = np.arange(tet_count)
    tets = np.stack([0 * ids, 0 * ids + 1, 2 + ids, 2 + (ids + 1) % tet_count], axis=1)
    return np.concatenate([axis, rim(1)]), np.concatenate([axis, rim(turns)]), tets


def counted(feedback, x, overlong=False):
    vertices = wp.array(x.astype(np.float32), dtype=wp.vec3, device=feedback._device)
    feedback.end(vertices, count=True, overlong=overlong)
    inverted, wrapped, lost = feedback.read()[2]
    assert not lost.any() or np.isnan(x).any()
    return inverted, wrapped


def counts(rest, x, tets, device, parts=None):
    parts = np.zeros(len(rest), int) if parts is None else parts
    return counted(tangles.Feedback(rest, tets, parts, wp.zeros(1, device=device)), x)


def test_two_sheets_have_positive_volumes_and_are_a_tangle(device):
    rest, x, tets = wheel(9, turns=2)
    assert (signed_volumes(rest, tets) > 0).all() and (signed_volumes(x, tets) > 0).all()
    np.testing.assert_array_equal(counts(rest, rest, tets, device), [[0], [0]])
    np.testing.assert_array_equal(counts(rest, x, tets, device), [[0], [1]])


def test_inverted_and_squeezed_tets_are_counted_alone_too(device):
    mesh = a15_grid(0.25)
    feedback = tangles.Feedback(
        mesh.rest_vertices, mesh.tets, np.zeros(mesh.vertex_count, int), wp.zeros(1, device=device)
    )
    for height, expected in ((0.6, (0, 0)), (0.4, (0, 1)), (-0.6, (1, 1))):
        flat = (mesh.rest_vertices * [1.0, 1.0, height]).astype(np.float32)
        feedback.end(wp.array(flat, dtype=wp.vec3, device=device), count=False, inverted=True)
        _, volumes, all_tangles = feedback.read()
        assert all_tangles is None
        np.testing.assert_array_equal(volumes, mesh.tet_count * np.array(expected)[:, None])


def test_an_edge_wrapped_at_rest_is_no_tangle(device):
    _, x, tets = wheel(9, turns=2)
    np.testing.assert_array_equal(counts(x, x, tets, device), [[0], [0]])


def test_angles_add_up_to_2_pi_inside_and_to_less_outside():
    mesh = a15_grid(0.25)
    fans = tangles.fans(mesh.rest_vertices, mesh.tets)
    assert len(fans.others) == 6 * mesh.tet_count
    sums = tangles.angle_sums(mesh.rest_vertices, fans.ends, fans.offsets, fans.others)
    assert sums.max() == pytest.approx(2 * np.pi)
    assert ((sums < 2 * np.pi - 0.1) | np.isclose(sums, 2 * np.pi)).all()
    assert np.isclose(sums, 2 * np.pi).any()


def test_a_twisted_body_is_no_tangle(device):
    mesh = a15_grid(0.125)
    rest = mesh.rest_vertices
    angle = np.random.default_rng().uniform(0.5, 1.5) * (rest[:, 2:] - 0.5)
    c, s = np.cos(angle)[:, 0], np.sin(angle)[:, 0]
    x, y = rest[:, 0] - 0.5, rest[:, 1] - 0.5
    twisted = np.stack([c * x - s * y, s * x + c * y, rest[:, 2]], axis=1)
    np.testing.assert_array_equal(counts(rest, twisted, mesh.tets, device), [[0], [0]])


def test_overlong_edges_count_if_asked_for(device):
    rest, _, tets = wheel(9, turns=1)
    parts = np.zeros(len(rest), int)
    feedback = tangles.Feedback(rest, tets, parts, wp.zeros(1, device=device))
    for scale, overlong, expected in ((1.9, True, 0), (2.1, False, 0), (2.1, True, 28)):
        np.testing.assert_array_equal(counted(feedback, scale * rest, overlong), [[0], [expected]])


def test_inverted_flat_and_nan_tets_count_in_their_part(device):
    mesh = a15_grid(0.25)
    rest = np.concatenate([mesh.rest_vertices, mesh.rest_vertices + 2.0])
    tets = np.concatenate([mesh.tets, mesh.tets + mesh.vertex_count])
    parts = np.repeat([0, 1], mesh.vertex_count)
    for spoil in (lambda a: a * [1, 1, -1], lambda a: a * [1, 1, 0], lambda a: a * np.nan):
        x = rest.copy()
        x[mesh.vertex_count :] = spoil(x[mesh.vertex_count :])
        inverted, _ = counts(rest, x, tets, device, parts)
        np.testing.assert_array_equal(inverted, [0, mesh.tet_count])


def test_tets_that_are_not_finite_are_counted_beside(device):
    mesh = a15_grid(0.25)
    x = mesh.rest_vertices.copy()
    x[mesh.tets[0, 0]] = np.nan
    feedback = tangles.Feedback(
        mesh.rest_vertices, mesh.tets, np.zeros(len(x), int), wp.zeros(1, device=device)
    )
    feedback.end(wp.array(x.astype(np.float32), dtype=wp.vec3, device=device), count=True)
    _, _, (inverted, _, lost) = feedback.read()
    expected = (mesh.tets == mesh.tets[0, 0]).any(axis=1).sum()
    assert lost[0] == inverted[0] == expected
