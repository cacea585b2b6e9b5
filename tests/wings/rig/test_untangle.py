"""Untangling: nothing moves where all is well, and no tet stays inverted."""

import numpy as np
import pytest
from bone_physics import posed_with_physics

from deformrf.core.deform import Material, XpbdOptions, XpbdSolver
from deformrf.core.geometry import a15_grid, extract
from deformrf.wings.rig import (
    Clip,
    Rig,
    VertexClip,
    automatic_weights,
    clip_of_poses,
    clip_quality,
    driven_vertices,
    make_skeleton,
    rigid_weights,
    skinned,
    turned,
)
from deformrf.wings.rig.quality import frame_times
from deformrf.wings.rig.skeleton import skinning_matrices
from deformrf.wings.rig.untangle import Untangler


@pytest.fixture(scope="module")
def bar():
    """A bar along z of two bones, and a pose that folds it in half."""
    grid = a15_grid(0.06)
    middles = grid.rest_vertices[grid.tets].mean(axis=1)
    mesh, _ = extract(grid, (np.abs(middles[:, :2] - 0.5) < 0.13).all(axis=1))
    heads, tails = [[0.5, 0.5, 0.0], [0.5, 0.5, 0.5]], [[0.5, 0.5, 0.5], [0.5, 0.5, 1.0]]
    skeleton = make_skeleton(("lower", "upper"), (-1, 0), heads, tails)
    return mesh, skeleton, turned(skeleton, skeleton.rest_pose, 1, [1.6, 0.0, 0.0])


def posed_vertices(bar, weights, offsets=None):
    mesh, skeleton, pose = bar
    matrices = skinning_matrices(skeleton, pose)
    return skinned(mesh.rest_vertices, weights, matrices, offsets=offsets)


def test_what_is_well_does_not_move(bar):
    mesh, _, _ = bar
    vertices = mesh.rest_vertices @ np.diag([1.2, 0.8, 1.0])
    np.testing.assert_array_equal(Untangler(mesh)(vertices), vertices)


def test_torn_tets_are_mended_and_the_rest_stays_near(bar):
    mesh, skeleton, _ = bar
    vertices = posed_vertices(bar, rigid_weights(mesh, skeleton))
    untangler = Untangler(mesh)
    assert (untangler.ratios(vertices) <= 0.0).sum() > 3
    mended = untangler(vertices)
    assert untangler.ratios(mended).min() > 0.0
    moved = np.linalg.norm(mended - vertices, axis=1)
    assert np.median(moved) < 0.01 and moved[mesh.rest_vertices[:, 2] < 0.2].max() < 0.01


def test_a_moved_pose_is_mended_alike(bar):
    mesh, skeleton, _ = bar
    vertices = posed_vertices(bar, rigid_weights(mesh, skeleton))
    untangler, turn = Untangler(mesh), np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    there = untangler(vertices @ turn.T + 0.3)
    np.testing.assert_allclose(there, untangler(vertices) @ turn.T + 0.3, atol=1e-4)


def test_bones_drive_what_is_near_them(bar):
    mesh, skeleton, _ = bar
    assert len(driven_vertices(mesh, skeleton, 0.0)) == mesh.vertex_count
    half = driven_vertices(mesh, skeleton, 0.5)
    assert len(half) == pytest.approx(0.5 * mesh.vertex_count, abs=2)
    away = np.linalg.norm(mesh.rest_vertices[:, :2] - 0.5, axis=1)
    assert away[half].mean() < 0.8 * away.mean()
    assert 8 <= len(driven_vertices(mesh, skeleton, 1.0)) < 0.1 * mesh.vertex_count
    with pytest.raises(ValueError, match=r"softness is 1\.5"):
        driven_vertices(mesh, skeleton, 1.5)


def test_physics_follows_the_bones_without_torn_tets(bar):
    mesh, skeleton, pose = bar
    weights = automatic_weights(mesh, skeleton)
    away = np.float32([0.02, 0.0, 0.0]) * weights.prod(axis=1)[:, None]
    offsets = np.stack([away, -away], axis=1)
    rig = Rig(skeleton, weights, offsets=offsets)
    options = XpbdOptions(contact=False, rescue=False)
    pinned = np.zeros(mesh.vertex_count, bool)
    solver = XpbdSolver(mesh.rest_vertices, mesh.tets, Material(), pinned, options)
    found = posed_with_physics(solver, mesh, rig, pose, 0.5, ticks=20, settle=60)
    assert Untangler(mesh).ratios(found).min() > 0.0
    skin = posed_vertices(bar, rig.weights, rig.offsets)
    assert np.linalg.norm(found - skin, axis=1).mean() < 0.05
    driven = driven_vertices(mesh, skeleton, 0.5)
    # Untangling may move some of them a little.
    assert np.linalg.norm((found - skin)[driven], axis=1).max() < 2e-3


def test_quality_names_the_worst_bone_and_place(bar):
    mesh, skeleton, pose = bar
    clip = clip_of_poses("Fold", [0.0, 1.0], [skeleton.rest_pose, pose])
    rig = Rig(skeleton, rigid_weights(mesh, skeleton), (clip,))
    quality = clip_quality(mesh, rig, clip)
    assert len(quality.times) == 25 and quality.smallest[0] == pytest.approx(1.0)
    assert quality.inverted[0] == 0 < quality.inverted[-1]
    assert quality.worst.ratio == quality.smallest.min() == quality.bone_smallest.min()
    assert quality.worst.ratio == quality.worst_ratios[quality.worst.tet]
    assert quality.bone_tets.sum() == mesh.tet_count
    assert abs(quality.worst.place[2] - 0.5) < 0.15  # at the bend
    mended = clip_quality(mesh, rig, clip, times=[1.0], untangle=True)
    assert mended.inverted.tolist() == [0] and mended.smallest[0] > 0.0


def test_quality_of_vertices_over_time(bar):
    mesh, skeleton, _ = bar
    x = mesh.rest_vertices.astype(np.float32)
    clip = VertexClip("Mirror", np.array([0.0, 1.0]), np.stack([x, x * [-1, 1, 1]]))
    rig = Rig(skeleton, rigid_weights(mesh, skeleton), (clip,))
    quality = clip_quality(mesh, rig, clip, times=[0.0, 1.0])
    assert quality.inverted.tolist() == [0, mesh.tet_count]


def test_frames_cover_a_clip():
    assert frame_times(0.0).tolist() == [0.0]
    times = frame_times(1.0)
    assert len(times) == 25 and times[-1] == 1.0
    assert len(frame_times(10000.0)) == 240
    assert Clip("c", 0.0, ()).duration == 0.0
