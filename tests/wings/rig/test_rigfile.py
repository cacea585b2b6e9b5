"""Rigs in files: every bit comes back; what is no rig ends in one sentence."""

import json
from dataclasses import replace

import numpy as np
import pytest

from deformrf.core import field as fields
from deformrf.wings.rig import (
    Channel,
    Clip,
    Rig,
    VertexClip,
    arrays_of,
    load_rig,
    make_skeleton,
    rig_from,
)

V = 7


@pytest.fixture
def rig():
    rng = np.random.default_rng(3)
    skeleton = make_skeleton(("a", "b", "ç"), (-1, 0, 1), rng.normal(size=(3, 3)), np.eye(3))
    weights = rng.uniform(size=(V, 3)) * [1, 1, 0]
    weights = (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)
    away = rng.normal(size=(V, 1, 3))
    offsets = np.concatenate([away, -away, 0.0 * away], axis=1).astype(np.float32)
    times = np.array([0.0, 0.5])
    channels = (
        Channel(1, "rotation", "LINEAR", times, rng.normal(size=(2, 4))),
        Channel(0, "translation", "CUBICSPLINE", times, rng.normal(size=(2, 3, 3))),
        Channel(2, "scale", "STEP", times[:1], np.ones((1, 3))),
    )
    frames = rng.normal(size=(2, V, 3)).astype(np.float32)
    clips = VertexClip("v", times, frames), Clip("Run", 1.5, channels)
    return Rig(skeleton, weights, clips, offsets)


def assert_equal(found, wanted):
    assert found.skeleton.names == wanted.skeleton.names
    for name in ("parents", "rest", "tails"):
        np.testing.assert_array_equal(getattr(found.skeleton, name), getattr(wanted.skeleton, name))
    np.testing.assert_array_equal(found.weights, wanted.weights)
    np.testing.assert_array_equal(found.offsets, wanted.offsets)
    assert [c.name for c in found.clips] == [c.name for c in wanted.clips]
    np.testing.assert_array_equal(found.clips[0].vertices, wanted.clips[0].vertices)
    bones, others = found.clips[1], wanted.clips[1]
    assert bones.duration == others.duration
    for one, other in zip(bones.channels, others.channels, strict=True):
        assert (one.bone, one.path, one.interpolation) == (
            other.bone,
            other.path,
            other.interpolation,
        )
        np.testing.assert_array_equal(one.times, other.times)
        np.testing.assert_array_equal(one.values, other.values)


def test_every_bit_comes_back(rig, tmp_path):
    np.savez(tmp_path / "rig.npz", **arrays_of(rig))
    assert_equal(load_rig(tmp_path / "rig.npz", V), rig)


def test_a_rig_without_offsets_has_no_array_of_them(rig):
    arrays = arrays_of(replace(rig, offsets=None))
    assert "rig_offsets" not in arrays and rig_from(arrays, V).offsets is None
    older = arrays_of(rig)
    older.pop("rig_offsets")
    np.testing.assert_array_equal(rig_from(older, V).weights, rig.weights)


def test_a_model_carries_its_rig(make_ball_field, rig, tmp_path):
    field = make_ball_field(0)
    count = field.mesh.vertex_count
    first = np.arange(count) % 3
    one, other = np.eye(3, dtype=np.float32)[first], np.eye(3, dtype=np.float32)[first - 1]
    weights = 0.25 * one + 0.75 * other
    away = np.random.default_rng().normal(size=(count, 1, 3)).astype(np.float32)
    offsets = (one - other)[:, :, None] * away
    rig = Rig(rig.skeleton, weights, rig.clips[1:], offsets)
    fields.save(replace(field, rig_arrays=arrays_of(rig)), tmp_path / "model.npz")
    loaded = fields.load(tmp_path / "model.npz")
    again = rig_from(loaded.rig_arrays, count)
    np.testing.assert_array_equal(again.weights, weights)
    np.testing.assert_array_equal(again.offsets, offsets)
    fields.save(field, tmp_path / "bare.npz")
    assert fields.load(tmp_path / "bare.npz").rig_arrays is None
    half = fields.cut(loaded, [[0.0, 0.0, 0.5], [1.0, 1.0, 1.0]])
    _, used = np.unique(half.mesh.rest_vertices, axis=0, return_index=True)
    found = rig_from(half.rig_arrays, half.mesh.vertex_count)
    place = {tuple(x): v for v, x in enumerate(field.mesh.rest_vertices)}
    before = [place[tuple(x)] for x in half.mesh.rest_vertices[used]]
    np.testing.assert_array_equal(found.weights[used], weights[before])
    np.testing.assert_array_equal(found.offsets[used], offsets[before])


def test_a_model_with_offsets_of_other_vertices_is_refused(make_ball_field, rig, tmp_path):
    field, path = make_ball_field(0), tmp_path / "model.npz"
    fields.save(replace(field, rig_arrays={"rig_offsets": np.zeros((V, 2, 3), np.float32)}), path)
    with pytest.raises(ValueError, match=r"model.npz: 'rig_offsets' is float32 \[7, 2, 3\], it"):
        fields.load(path)


def changed(name, index, value):
    def change(arrays):
        arrays[name] = arrays[name].copy()
        arrays[name][index] = value

    return change


def one_bone_alone(arrays):
    """Vertex 3 has one weight, and two offsets."""
    arrays["rig_weights"] = arrays["rig_weights"].copy()
    arrays["rig_weights"][3] = 1.0, 0.0


def meta(**values):
    def change(arrays):
        text = json.loads(arrays["rig_meta"].tobytes()) | values
        arrays["rig_meta"] = np.frombuffer(json.dumps(text).encode(), np.uint8)

    return change


def dropped(name):
    return lambda arrays: arrays.pop(name)


def shortened(name):
    return lambda arrays: arrays.update({name: arrays[name][:-1]})


@pytest.mark.parametrize(
    "change, sentence",
    [
        (dropped("rig_parents"), "no array 'rig_parents'"),
        (dropped("rig_frames_0"), "no array 'rig_frames_0'"),
        (changed("rig_parents", 1, 2), "no bone may be its own ancestor"),
        (changed("rig_parents", 2, 9), "the parent of bone 'ç' is number 9"),
        (changed("rig_weights", 3, 0.1), "the weights of vertex 3 sum to"),
        (changed("rig_weights", 3, np.nan), "vertex 3 hold NaN"),
        (changed("rig_weight_bones", 0, 5), "weights of bone 5"),
        (changed("rig_offsets", 3, np.nan), "the offsets of vertex 3 hold NaN"),
        (changed("rig_offsets", (3, 0), 9.0), "the offsets of vertex 3 sum to"),
        (one_bone_alone, "vertex 3 has an offset for a bone that has no weight there"),
        (shortened("rig_offsets"), r"'rig_offsets' is float32 \[6, 2, 3\], it should be"),
        (lambda a: a.update(rig_offsets=a["rig_offsets"][:, :1]), r"it should be .*7, 2, 3"),
        (lambda a: a.update(rig_offsets=a["rig_offsets"][..., 0]), r"it should be .*7, 2, 3"),
        (lambda a: a.update(rig_offsets=a["rig_offsets"] > 0), "'rig_offsets' is bool"),
        (changed("rig_rest", (1, 0, 3), np.nan), "rest frame of bone 'b' holds NaN"),
        (changed("rig_times", 0, np.nan), "times that are not between"),
        (changed("rig_channels", (0, 1), 5), "animates bone number 5"),
        (changed("rig_channels", (0, 4), 10**6), "which no clip of it can have"),
        (changed("rig_channels", (0, 0), 0), "which no clip of it can have"),
        (shortened("rig_values"), "ends too early"),
        (shortened("rig_weights"), "weights for 6 vertices, but the model has 7"),
        (shortened("rig_frames_0"), "it should be float32"),
        (lambda a: a.update(rig_tails=a["rig_tails"].astype(np.float32)), "it should be float64"),
        (meta(bones=["a", "b"]), "it should be int32"),
        (meta(bones=["a"] * 5000), "no list of at most 1024"),
        (meta(bones=["a", "b", 3]), "a bone's name is"),
        (meta(clips=[{"name": "x"}]), "no list of at most"),
        (meta(format_version=9), "format version 9"),
        (meta(format="other"), "names no format"),
        (lambda a: a.update(rig_meta=np.frombuffer(b"[" * 10**5, np.uint8)), "is no JSON"),
        (lambda a: a.update(rig_meta=np.frombuffer(b"\xff\xfe", np.uint8)), "is no JSON"),
    ],
)
def test_bad_rigs_end_in_one_sentence(rig, tmp_path, change, sentence):
    arrays = arrays_of(rig)
    change(arrays)
    with pytest.raises(ValueError, match=sentence):
        rig_from(arrays, V)
    np.savez(tmp_path / "rig.npz", **arrays)
    with pytest.raises(ValueError, match=sentence) as caught:
        load_rig(tmp_path / "rig.npz", V)
    assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_damaged_file_is_said_so(rig, tmp_path):
    path = tmp_path / "rig.npz"
    np.savez(path, **arrays_of(rig))
    whole = path.read_bytes()
    rng = np.random.default_rng()
    for _ in range(100):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 3):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged[: rng.integers(len(whole) // 2, len(whole) + 1)])
        try:
            load_rig(path, V)
        except ValueError as error:
            assert "\n" not in str(error)
    with pytest.raises(ValueError, match="there is no rig file"):
        load_rig(tmp_path / "none.npz", V)
