"""Clips: glTF's interpolations, time, matrices, and clips that are none."""

import numpy as np
import pytest

from deformrf.wings.rig import (
    Channel,
    Clip,
    VertexClip,
    clip_of_poses,
    make_skeleton,
    phase,
    posed,
    rotations,
    turned,
)
from deformrf.wings.rig.clips import clip_of_matrices, interpolated
from deformrf.wings.rig.skeleton import skinning_matrices


@pytest.fixture
def skeleton():
    return make_skeleton(("a", "b"), (-1, 0), [[0, 0, 0], [0, 0, 1]], [[0, 0, 1], [0, 0, 2]])


def channel(interpolation, values, times=(1.0, 2.0, 4.0), path="translation"):
    return Channel(0, path, interpolation, np.array(times, float), np.array(values, float))


def value_at(one, seconds):
    return interpolated(one, one.values, seconds)


def test_steps_hold_and_lines_join():
    values = np.random.default_rng().normal(size=(3, 3))
    step, line = (channel(kind, values) for kind in ("STEP", "LINEAR"))
    for seconds, k in ((0.0, 0), (1.0, 0), (1.99, 0), (2.0, 1), (4.0, 2), (9.0, 2)):
        np.testing.assert_array_equal(value_at(step, seconds), values[k])
    np.testing.assert_allclose(value_at(line, 2.5), 0.75 * values[1] + 0.25 * values[2])
    np.testing.assert_array_equal(value_at(line, 0.5), values[0])
    np.testing.assert_array_equal(value_at(line, 7.0), values[2])


def test_cubic_splines_pass_keys_with_their_tangents():
    keys = np.random.default_rng().normal(size=(3, 3, 3))
    spline, small = channel("CUBICSPLINE", keys), 1e-6
    for k, seconds in enumerate((1.0, 2.0, 4.0)):
        np.testing.assert_allclose(value_at(spline, seconds), keys[k, 1], atol=1e-12)
    after = (value_at(spline, 2.0 + small) - value_at(spline, 2.0)) / small
    before = (value_at(spline, 2.0) - value_at(spline, 2.0 - small)) / small
    np.testing.assert_allclose(after, keys[1, 2], atol=1e-4)
    np.testing.assert_allclose(before, keys[1, 0], atol=1e-4)


def test_a_cubic_spline_holds_a_cubic():
    def cubic(t):
        return np.stack([t**3, 2.0 * t - t**2, np.ones_like(t)], axis=-1)

    def slope(t):
        return np.stack([3.0 * t**2, 2.0 - 2.0 * t, np.zeros_like(t)], axis=-1)

    times = np.array([1.0, 2.0, 4.0])
    keys = np.stack([slope(times), cubic(times), slope(times)], axis=1)
    for seconds in (1.3, 2.2, 3.7):
        found = value_at(channel("CUBICSPLINE", keys), seconds)
        np.testing.assert_allclose(found, cubic(np.array(seconds)))


def test_rotations_take_the_shorter_way():
    values = [rotations.of_vector([0, 0, 0.2]), -rotations.of_vector([0, 0, 0.8])]
    found = value_at(channel("LINEAR", values, (0.0, 1.0), "rotation"), 0.5)
    np.testing.assert_allclose(np.abs(found @ rotations.of_vector([0, 0, 0.5])), 1.0)


def test_bones_without_channels_rest(skeleton):
    clip = Clip("c", 4.0, (channel("LINEAR", np.ones((3, 3))),))
    pose = clip.pose_at(skeleton, 3.0)
    np.testing.assert_array_equal(pose.translations[0], [1, 1, 1])
    np.testing.assert_array_equal(pose.translations[1], skeleton.rest_pose.translations[1])
    np.testing.assert_array_equal(pose.rotations, skeleton.rest_pose.rotations)


def test_poses_and_matrices_make_the_same_clip(skeleton):
    times = [0.0, 0.5, 2.0]
    poses = [turned(skeleton, skeleton.rest_pose, 1, [t, 0.3, 0.0]) for t in times]
    matrices = np.array([skinning_matrices(skeleton, pose) for pose in poses])
    clips = clip_of_poses("a", times, poses), clip_of_matrices("b", skeleton, times, matrices)
    for clip in clips:
        assert clip.duration == 2.0
        for seconds, wanted in zip(times, matrices, strict=True):
            np.testing.assert_allclose(clip.matrices_at(skeleton, seconds), wanted, atol=1e-9)
    still = [c for c in clips[0].channels if c.path == "scale"]
    assert all(len(c.times) == 1 for c in still)
    frames = [posed(skeleton, clip.pose_at(skeleton, 0.2)) for clip in clips]
    np.testing.assert_allclose(*frames, atol=1e-9)


@pytest.mark.parametrize("change, sentence", [("nan", "hold NaN"), ("shear", "flattens or shears")])
def test_bad_matrices_end_in_one_sentence(skeleton, change, sentence):
    matrices = np.tile(np.eye(4), (2, 2, 1, 1))
    matrices[1, 1, 0, 1] = np.nan if change == "nan" else 0.5
    with pytest.raises(ValueError, match=sentence):
        clip_of_matrices("Run", skeleton, [0.0, 1.0], matrices)


def test_vertices_move_on_straight_lines():
    vertices = np.random.default_rng().normal(size=(3, 5, 3)).astype(np.float32)
    clip = VertexClip("v", np.array([0.0, 1.0, 3.0]), vertices)
    assert clip.duration == 3.0
    np.testing.assert_array_equal(clip.vertices_at(1.0), vertices[1])
    np.testing.assert_array_equal(clip.vertices_at(5.0), vertices[2])
    np.testing.assert_allclose(clip.vertices_at(2.0), vertices[1:].mean(axis=0), atol=1e-6)


def test_time_loops_and_runs_backwards():
    assert phase(2.0, 5.0) == 1.0 and phase(2.0, -0.5) == 1.5
    assert phase(0.0, 3.0) == 0.0


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ((0, "translation", "LINEAR", [0.0, 1.0], np.zeros((3, 3))), "has values"),
        ((0, "translation", "LINEAR", [0.0, 0.0], np.zeros((2, 3))), "not in order"),
        ((0, "translation", "LINEAR", [np.nan, 1.0], np.zeros((2, 3))), "not between 0"),
        ((0, "translation", "LINEAR", [0.0], np.full((1, 3), np.nan)), "hold NaN"),
        ((0, "rotation", "CUBICSPLINE", [0.0], np.zeros((1, 4))), "has values"),
        ((0, "weights", "LINEAR", [0.0], np.zeros((1, 4))), "is called 'weights'"),
        ((0, "scale", "LINEAR", [], np.zeros((0, 3))), "have no times"),
    ],
)
def test_bad_channels_end_in_one_sentence(arguments, sentence):
    bone, path, interpolation, times, values = arguments
    with pytest.raises(ValueError, match=sentence):
        Channel(bone, path, interpolation, np.array(times), values)


def test_a_clip_ends_after_its_keys():
    with pytest.raises(ValueError, match=r"lasts 1\.0 s, its keys 4\.0 s"):
        Clip("c", 1.0, (channel("LINEAR", np.zeros((3, 3))),))
    with pytest.raises(ValueError, match="printable"):
        Clip("a\x1b[2J", 1.0, ())
