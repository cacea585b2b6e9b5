"""deformrf rig export, check and import."""

import importlib.util
import json
from types import SimpleNamespace

import numpy as np
import pytest
from point_caches import write_cache

from deformrf.commands.rig import main
from deformrf.core import field as fields
from deformrf.core.geometry import boundary_faces
from deformrf.wings.rig import VertexClip, make_skeleton, rig_from


@pytest.fixture
def cache(ball, tmp_path):
    """A point cache of the ball, squashed to half its height in its last frame."""
    rest = ball.mesh.rest_vertices
    heights = np.array([1.0, 0.75, 0.5])[:, None]
    vertices = np.repeat(rest[None], 3, axis=0)
    vertices[..., 2] *= heights
    clip = VertexClip("squash", np.arange(3) / 24.0, vertices.astype(np.float32))
    return SimpleNamespace(clip=clip, path=write_cache(clip, tmp_path / "squash.pc2"))


def test_the_mesh_is_exported_with_colors_and_preview(ball_file, tmp_path, call):
    result = call(main, "export", ball_file, "-o", tmp_path / "ball.ply")
    assert result.code == 0 and "deformrf_rig.py" in result.out
    header = (tmp_path / "ball.ply").read_bytes().partition(b"end_header")[0]
    for words in (b"element tet 364", b"property uchar red", b"element preview_vertex"):
        assert words in header


def test_other_endings_are_refused(ball_file, tmp_path, call, refused):
    result = call(main, "export", ball_file, "-o", tmp_path / "ball.obj")
    assert ".vtu" in refused(result)


@pytest.mark.parametrize(("ending", "package"), [(".vtu", "meshio"), (".usda", "pxr")])
def test_a_missing_package_is_named(
    ball_file, tmp_path, call, refused, monkeypatch, ending, package
):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n == package else find(n))
    result = call(main, "export", ball_file, "-o", tmp_path / f"ball{ending}")
    sentence = refused(result)
    assert package in sentence and ".[exchange]" in sentence


def test_check_tells_volumes_and_inverted_tets(ball_file, cache, ball, tmp_path, call):
    result = call(main, "check", ball_file, cache.path)
    assert result.code == 0
    assert "3 frames" in result.out and "volume ratio 0.50" in result.out
    mirrored = cache.clip.vertices * np.float32([1.0, 1.0, -1.0])
    clip = VertexClip("mirror", cache.clip.times, mirrored)
    result = call(main, "check", ball_file, write_cache(clip, tmp_path / "mirror.mdd"))
    assert result.code == 1 and f"{ball.mesh.tet_count} inverted tets" in result.out


def test_a_cache_becomes_a_clip_of_the_model(ball_file, cache, ball, tmp_path, call):
    rigged = tmp_path / "rigged.npz"
    for fps in (24, 12):  # the second time it replaces the clip
        model = ball_file if fps == 24 else rigged
        assert call(main, "import", model, cache.path, "-o", rigged, "--fps", fps).code == 0
        rig = rig_from(fields.load(rigged).rig_arrays, ball.mesh.vertex_count)
        (clip,) = rig.clips
        assert clip.name == "squash" and clip.duration == pytest.approx(2 / fps)
        np.testing.assert_array_equal(clip.vertices, cache.clip.vertices)


@pytest.fixture
def from_blender(ball, tmp_path):
    """The add-on's file: two bones, whose weights are the height, and none of the upper inside."""
    rest = ball.mesh.rest_vertices.astype(np.float32)
    upper = np.clip(2.0 * rest[:, 2] - 0.5, 0.0, 1.0)
    inside = np.setdiff1d(np.arange(len(rest)), boundary_faces(ball.mesh.tets, ball.neighbours)[0])
    upper[inside] = 0.0
    weights = np.column_stack([1.0 - upper, upper]).astype(np.float32)
    bones = make_skeleton(["a", "b"], [-1, 0], [[0.5, 0.5, 0.0], [0.5] * 3], [[0.5] * 3] * 2)
    matrices = np.tile(np.eye(4), (2, 2, 1, 1))
    matrices[1, 1, 0, 3] = 0.1
    meta = {"format": "deformrf-blender", "format_version": 1, "blender": "5.0.1"}
    meta |= {"bones": ["a", "b"], "clips": ["Slide"], "shape_keys": [], "preserve_volume": True}
    np.savez(
        tmp_path / "rig.npz",
        meta=np.frombuffer(json.dumps(meta).encode(), np.uint8),
        rest_vertices=rest,
        weights=weights,
        bone_parents=bones.parents,
        bone_rest=bones.rest,
        bone_tails=bones.tails,
        shape_keys=np.zeros((0, len(rest), 3), np.float32),
        times_0=np.arange(2) / 24.0,
        matrices_0=matrices,
        shape_values_0=np.zeros((2, 0), np.float32),
    )
    return SimpleNamespace(path=tmp_path / "rig.npz", weights=weights, inside=inside)


def test_a_rig_of_blender_becomes_the_models(ball_file, from_blender, ball, tmp_path, call):
    result = call(main, "check", ball_file, from_blender.path)
    assert result.code == 0 and "2 bones" in result.out and "Slide: 2 frames" in result.out
    for inside in ("harmonic", "file"):
        output = tmp_path / f"{inside}.npz"
        result = call(
            main, "import", ball_file, from_blender.path, "-o", output, "--inside", inside
        )
        assert result.code == 0 and "dual quaternion" in result.out
        rig = rig_from(fields.load(output).rig_arrays, ball.mesh.vertex_count)
        changed = np.abs(rig.weights - from_blender.weights).max(axis=1) > 1e-4
        expected = from_blender.inside if inside == "harmonic" else []
        assert set(np.flatnonzero(changed)) <= set(expected)
        assert changed.any() == (inside == "harmonic")


def test_the_file_of_a_rig_is_not_written_over(ball_file, from_blender, call, refused):
    before = from_blender.path.read_bytes()
    for command in ("import", "bind"):
        done = call(main, command, ball_file, from_blender.path, "-o", from_blender.path)
        assert "is read, and would be lost" in refused(done)
    assert from_blender.path.read_bytes() == before


def test_a_cache_of_another_mesh_is_refused(ball_file, tmp_path, call, refused):
    clip = VertexClip("other", np.zeros(1), np.zeros((1, 9, 3), np.float32))
    path = write_cache(clip, tmp_path / "other.npz")
    assert "9 vertices" in refused(call(main, "check", ball_file, path))
