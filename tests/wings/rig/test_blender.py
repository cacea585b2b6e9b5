"""The file of the Blender add-on: what it becomes, and what of it is refused."""

import json

import numpy as np
import pytest

from deformrf.core.geometry import a15_grid, boundary_faces, tet_neighbours
from deformrf.wings.rig import (
    Clip,
    VertexClip,
    make_skeleton,
    read_blender,
    rig_of,
    rotations,
    skinned,
    skinning_error,
)


@pytest.fixture(scope="module")
def mesh():
    return a15_grid(0.125)


def bend(angles):
    """Skinning matrices of two bones, the second turned about the cube's middle.  [K, 2, 4, 4]"""
    matrices = np.tile(np.eye(4), (len(angles), 2, 1, 1))
    middle = np.full(3, 0.5)
    for k, angle in enumerate(angles):
        turn = rotations.matrix_of(rotations.of_vector(np.array([angle, 0.0, 0.0])))
        matrices[k, 1, :3, :3] = turn
        matrices[k, 1, :3, 3] = middle - turn @ middle
    return matrices


@pytest.fixture
def arrays(mesh):
    """What the add-on writes for the cube with two bones along z."""
    rest = mesh.rest_vertices.astype(np.float32)
    upper = np.clip(2.0 * rest[:, 2] - 0.5, 0.0, 1.0)
    weights = np.column_stack([1.0 - upper, upper]).astype(np.float32)
    bones = make_skeleton(["a", "b"], [-1, 0], [[0.5, 0.5, 0], [0.5] * 3], [[0.5] * 3] * 2)
    matrices = bend([0.0, 0.4, 0.8])
    meta = {
        "format": "deformrf-blender",
        "format_version": 1,
        "blender": "5.0.1",
        "bones": ["a", "b"],
        "clips": ["Bend"],
        "shape_keys": ["Up"],
        "preserve_volume": False,
    }
    return {
        "meta": np.frombuffer(json.dumps(meta).encode(), np.uint8),
        "rest_vertices": rest,
        "weights": weights,
        "bone_parents": bones.parents,
        "bone_rest": bones.rest,
        "bone_heads": bones.heads,
        "bone_tails": np.array([[0.5] * 3, [0.5, 0.5, 1.0]]),
        "shape_keys": np.tile(np.float32([0, 0, 1]), (1, len(rest), 1)),
        "times_0": np.arange(3) / 24.0,
        "matrices_0": matrices,
        "shape_values_0": np.zeros((3, 1), np.float32),
        "vertices_0": np.float32([skinned(rest, weights, m) for m in matrices]),
    }


@pytest.fixture
def saved(tmp_path):
    def saved(arrays):
        np.savez(tmp_path / "rig.npz", **arrays)
        return tmp_path / "rig.npz"

    return saved


def test_bones_and_clips_arrive(arrays, saved, mesh):
    found = read_blender(saved(arrays), mesh)
    rig = rig_of(found, mesh, harmonic=False)
    assert rig.skeleton.names == ("a", "b") and found.method == "linear"
    np.testing.assert_allclose(rig.weights, arrays["weights"], atol=1e-6)
    (clip,) = rig.clips
    assert isinstance(clip, Clip)
    for k, second in enumerate(arrays["times_0"]):
        matrices = clip.matrices_at(rig.skeleton, second)
        np.testing.assert_allclose(matrices, arrays["matrices_0"][k], atol=1e-6)
    assert skinning_error(found, found.clips[0], mesh) < 1e-6


def test_weights_inside_follow_from_the_surface(arrays, saved, mesh):
    faces, _ = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
    outside = np.unique(faces)
    inside = np.setdiff1d(np.arange(mesh.vertex_count), outside)
    arrays["weights"] = arrays["weights"].copy()
    arrays["weights"][inside] = (1.0, 0.0)
    rig = rig_of(read_blender(saved(arrays), mesh), mesh)
    np.testing.assert_allclose(rig.weights[outside], arrays["weights"][outside], atol=1e-5)
    near_top = inside[mesh.rest_vertices[inside, 2] > 0.75]
    assert len(near_top) and (rig.weights[near_top, 1] > 0.5).all()


def test_what_bones_do_not_tell_is_kept_as_vertices(arrays, saved, mesh):
    arrays["vertices_0"] = arrays["vertices_0"] + np.float32(0.01)
    (clip,) = rig_of(read_blender(saved(arrays), mesh), mesh).clips
    assert isinstance(clip, VertexClip)
    np.testing.assert_array_equal(clip.vertices, arrays["vertices_0"])


def test_shape_keys_move_the_rest_vertices(arrays, saved, mesh):
    del arrays["vertices_0"]
    arrays["shape_values_0"] = np.float32([[0.0], [0.0], [0.5]])
    (clip,) = rig_of(read_blender(saved(arrays), mesh), mesh, harmonic=False).clips
    rest = mesh.rest_vertices + np.array([0.0, 0.0, 0.5])
    expected = skinned(rest, arrays["weights"], arrays["matrices_0"][2])
    np.testing.assert_allclose(clip.vertices[2], expected, atol=1e-5)


def changed_meta(**changes):
    def change(arrays):
        meta = json.loads(arrays["meta"].tobytes()) | changes
        arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)

    return change


def with_value(name, index, value):
    def change(arrays):
        arrays[name] = arrays[name].copy()
        arrays[name][index] = value

    return change


def without(name):
    return lambda arrays: arrays.pop(name)


def cut(name, count):
    def change(arrays):
        arrays[name] = arrays[name][:count]

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (changed_meta(format="other"), "no format"),
        (changed_meta(format_version=2), "version '2'"),
        (changed_meta(bones=["a"]), "bone_parents"),
        (changed_meta(bones=["a", "a"]), "two bones"),
        (changed_meta(bones="ab"), "'bones' is no list"),
        (changed_meta(clips=["Bend", "more"]), "no array 'times_1'"),
        (without("bone_rest"), "no array 'bone_rest'"),
        (cut("weights", 5), "weights for 5 vertices"),
        (cut("vertices_0", 2), "vertices_0"),
        (with_value("weights", 3, (0.5, 0.1)), "weights of vertex 3 sum to 0.6"),
        (with_value("weights", 3, (1.5, -0.5)), "are negative"),
        (with_value("weights", 3, np.nan), "'weights' holds NaN"),
        (with_value("matrices_0", (1, 1, 0, 0), np.inf), "'matrices_0' holds NaN or infinity"),
        (with_value("bone_parents", 0, 1), "parent"),
        (with_value("rest_vertices", 7, 0.123), "vertex 7 lies elsewhere"),
        (with_value("times_0", 1, 99.0), "not in order"),
    ],
)
def test_a_bad_file_ends_in_one_sentence(arrays, saved, mesh, change, words):
    change(arrays)
    with pytest.raises(ValueError, match=words) as caught:
        rig_of(read_blender(saved(arrays), mesh), mesh)
    assert "\n" not in str(caught.value)


def test_a_surface_that_nobody_painted_is_refused(arrays, saved, mesh):
    faces, _ = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
    with_value("weights", int(faces.min()), 0.0)(arrays)
    with pytest.raises(ValueError, match="1 vertices of the surface have no weight"):
        rig_of(read_blender(saved(arrays), mesh), mesh)


def test_a_truncated_file_ends_in_one_sentence(arrays, saved, mesh):
    path = saved(arrays)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ValueError, match="damaged"):
        read_blender(path, mesh)
