"""Automatic weights: about 1 on a bone, ½ at a joint, whatever the mesh's edges and the size."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.geometry import a15_grid, extract
from deformrf.wings.rig import automatic_weights, make_skeleton
from deformrf.wings.rig.fitting import located
from deformrf.wings.rig.laplacian import laplacian
from deformrf.wings.rig.weights import bone_distances

JOINTS = np.array([0.05, 0.35, 0.65, 0.95])  # of three bones along z
RADIUS = 0.07


@pytest.fixture(scope="module", params=[0.05, 0.035, 0.025])
def spacing(request):
    return request.param


def chain(spacing, scale=1.0):
    """A capsule about three bones on one line; everything times `scale`."""
    grid = a15_grid(spacing)
    middles = grid.rest_vertices[grid.tets].mean(axis=1)
    nearest = np.stack([np.full(len(middles), 0.5)] * 2 + [middles[:, 2].clip(0.1, 0.9)], axis=1)
    inside = np.linalg.norm(middles - nearest, axis=1) < RADIUS + 0.5 * spacing
    mesh, _ = extract(grid, inside)
    places = scale * np.stack([np.full(4, 0.5), np.full(4, 0.5), JOINTS], axis=1)
    skeleton = make_skeleton(("first", "second", "third"), (-1, 0, 1), places[:-1], places[1:])
    return replace(mesh, rest_vertices=scale * mesh.rest_vertices), skeleton


def weights_at(mesh, weights, z, away=0.0):
    """Means over a circle about the bones, at heights z [K].  [K, B]"""
    found = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        x, y = 0.5 + away * np.cos(angle), 0.5 + away * np.sin(angle)
        tet, bary = located(mesh, np.stack([np.full(len(z), x), np.full(len(z), y), z], axis=1))
        assert (tet >= 0).all()
        found.append(np.einsum("nc,ncb->nb", bary, weights[mesh.tets[tet]]))
    return np.mean(found, axis=0)


@pytest.fixture(scope="module")
def bound(spacing):
    mesh, skeleton = chain(spacing)
    return mesh, automatic_weights(mesh, skeleton)


@pytest.mark.parametrize("away", [0.0, 0.5 * RADIUS])
def test_a_bone_has_all_weight_in_its_middle(bound, away):
    middles = 0.5 * (JOINTS[:-1] + JOINTS[1:])
    own = weights_at(*bound, middles, away)[range(3), range(3)]
    assert (own >= 0.95).all()


def test_the_skin_over_the_middle_of_a_bone_is_its_own(bound):
    assert weights_at(*bound, np.array([0.5]), 0.7 * RADIUS)[0, 1] >= 0.9


def test_two_bones_share_their_joint(bound):
    at_joints = weights_at(*bound, JOINTS[1:3], 0.7 * RADIUS)
    np.testing.assert_allclose(at_joints[[0, 0, 1, 1], [0, 1, 1, 2]], 0.5, atol=0.06)


@pytest.mark.parametrize("away", [0.0, 0.4 * RADIUS])
def test_near_the_bones_they_are_equal_within_half_an_edge_of_it(bound, spacing, away):
    shifts = np.linspace(-0.5 * spacing, 0.5 * spacing, 2)
    for bone in (0, 1):
        below, above = weights_at(*bound, JOINTS[bone + 1] + shifts, away)
        assert below[bone] > below[bone + 1] and above[bone] < above[bone + 1]


@pytest.mark.parametrize("away", [0.0, 0.7 * RADIUS])
def test_a_weight_falls_along_the_bones(bound, away):
    z = np.linspace(0.12, 0.88, 39)
    first, second, third = weights_at(*bound, z, away).T
    slack = 0.01
    assert np.diff(first).max() < slack and np.diff(third).min() > -slack
    assert np.diff(second[z <= 0.5]).min() > -slack and np.diff(second[z >= 0.5]).max() < slack


def test_finer_tets_change_little(bound, spacing):
    """Compared with the finest mesh, farther from the joints than a coarse edge."""
    z = np.array([0.1, 0.2, 0.25, 0.45, 0.5, 0.55, 0.75, 0.8, 0.9])
    finest = chain(0.02)
    wanted = weights_at(finest[0], automatic_weights(*finest), z, 0.5 * RADIUS)
    assert np.abs(weights_at(*bound, z, 0.5 * RADIUS) - wanted).max() < 0.08


@pytest.mark.parametrize("scale", [0.01, 30.0])
def test_a_larger_object_has_the_same_weights(scale):
    wanted = automatic_weights(*chain(0.05))
    np.testing.assert_allclose(automatic_weights(*chain(0.05, scale)), wanted, atol=2e-3)


def test_where_nothing_lies_between_distances_are_straight():
    grid = a15_grid(0.06)
    skeleton = make_skeleton(("a",), (-1,), [[0.5, 0.5, 0.1]], [[0.5, 0.5, 0.9]])
    found = bone_distances(grid, laplacian(grid), skeleton)[:, 0]
    x = grid.rest_vertices
    away = np.linalg.norm(x - np.c_[np.full((len(x), 2), 0.5), x[:, 2].clip(0.1, 0.9)], axis=1)
    assert (found >= away - 1e-12).all() and np.mean(found <= away + 1e-12) > 0.95


def test_a_part_that_no_bone_is_in_has_the_weights_of_the_bones_beside_it():
    """Many vertices of it are as near as each other: none of them is the only way in."""
    grid = a15_grid(0.05)
    middles = grid.rest_vertices[grid.tets].mean(axis=1)
    x, y, _ = middles.T
    mesh, _ = extract(grid, (np.abs(y - 0.5) < 0.12) & ((x < 0.3) | (x > 0.7)))
    heads, tails = [[0.15, 0.5, 0.0], [0.15, 0.5, 0.5]], [[0.15, 0.5, 0.5], [0.15, 0.5, 1.0]]
    skeleton = make_skeleton(("low", "high"), (-1, 0), heads, tails)
    weights = automatic_weights(mesh, skeleton)
    z, other = mesh.rest_vertices[:, 2], mesh.rest_vertices[:, 0] > 0.5
    for part in (other, ~other):
        low = np.mean(weights[part & (z < 0.4), 0])
        assert low == pytest.approx(np.mean(weights[part & (z > 0.6), 1]), abs=0.02)
        joint = weights[part & (np.abs(z - 0.5) < 0.03)]
        assert np.mean(joint, axis=0) == pytest.approx([0.5, 0.5], abs=0.03)
