"""deformrf rig: what a rig holds, and what is refused."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from gltf_files import ellipsoid, make_bar, make_skin
from PIL import Image

from deformrf.commands import rig as command
from deformrf.core import field as fields
from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.wings.rig import Clip, Rig, arrays_of, clip_of_poses, make_skeleton, rig_from, turned


@pytest.fixture
def model(make_ball_field, tmp_path):
    """A model file with a rig of two bones."""
    field = make_ball_field(0)
    heads, tails = [[0.5, 0.5, 0.2], [0.5, 0.5, 0.5]], [[0.5, 0.5, 0.5], [0.5, 0.5, 0.8]]
    skeleton = make_skeleton(("lower", "upper"), (-1, 0), heads, tails)
    upper = field.mesh.rest_vertices[:, 2] > 0.5
    weights = np.stack([~upper, upper], axis=1).astype(np.float32)
    rig = Rig(skeleton, weights, (Clip("Nod", 1.5, ()),))
    path = tmp_path / "rigged.npz"
    fields.save(replace(field, rig_arrays=arrays_of(rig)), path)
    return path


def test_info_shows_bones_and_clips(call, model):
    result = call(command.main, "info", model)
    assert result.code == 0
    assert "\n  lower: leads" in result.out and "\n    upper: leads" in result.out
    assert "Nod: 1.5 s" in result.out


def test_a_model_without_a_rig_says_what_gives_it_one(call, make_ball_field, tmp_path, refused):
    fields.save(make_ball_field(0), tmp_path / "bare.npz")
    assert "has no rig: deformrf rig bind" in refused(
        call(command.main, "info", tmp_path / "bare.npz")
    )


def test_a_bad_rig_in_a_model_is_one_sentence(call, model, refused):
    field = fields.load(model)
    arrays = field.rig_arrays | {"rig_parents": np.array([-1, 1], np.int32)}
    fields.save(replace(field, rig_arrays=arrays), model)
    assert "the parent of bone 'upper' is number 1" in refused(call(command.main, "info", model))


def test_bind_gives_a_model_bones_weights_and_clips(call, make_ball_field, tmp_path):
    """The skin of the bar lies on no ball: a matrix and automatic weights place it."""
    field = make_ball_field(0)
    fields.save(field, tmp_path / "model.npz", entry_bits=8)
    make_bar(np.random.default_rng())[0].save(tmp_path / "bar.glb")
    arguments = ["-o", tmp_path / "rigged.npz", "--weights", "automatic", "--transform"]
    arguments += [0.3, 0, 0, 0.5, 0, 0.3, 0, 0.5, 0, 0, 0.3, 0.5, 0, 0, 0, 1]
    result = call(command.main, "bind", tmp_path / "model.npz", tmp_path / "bar.glb", *arguments)
    assert result.code == 0 and "2 bones, clips Wave" in result.out
    loaded = fields.load(tmp_path / "rigged.npz")
    assert loaded.entry_bits == 8
    rig = rig_from(loaded.rig_arrays, field.mesh.vertex_count)
    assert rig.skeleton.names == ("lower", "upper")
    other = tmp_path / "again.npz"
    again = call(command.main, "bind", tmp_path / "model.npz", tmp_path / "rigged.npz", "-o", other)
    assert again.code == 0
    copied = rig_from(fields.load(other).rig_arrays, field.mesh.vertex_count)
    np.testing.assert_array_equal(copied.weights, rig.weights)


@pytest.mark.parametrize(
    "name, flags, sentence",
    [
        (
            "bar.glb",
            ["--transform", *np.diag([1.0, 1, -1, 1]).ravel()],
            "--transform mirrors",
        ),
        ("bar.glb", ["--transform", *np.eye(4).ravel() * np.nan], "--transform is no finite"),
        ("bar.glb", ["--transform", *np.diag([9, 9, 9, 1]).ravel()], "lies inside the model"),
        ("none.glb", [], "there is no file at"),
        ("bar.fbx", [], "has to be a .glb, .gltf, .npz or .json"),
        ("rigged.npz", ["--weights", "rigid"], "leave out --weights and --transform"),
        ("rig.json", ["--weights", "harmonic"], "has no skinned mesh"),
    ],
)
def test_what_can_not_be_bound_is_said_so(call, model, tmp_path, refused, name, flags, sentence):
    make_bar(np.random.default_rng())[0].save(tmp_path / "bar.glb")
    bone = {"name": "a", "parent": None, "head": [0, 0, 0], "tail": [0, 0, 1]}
    (tmp_path / "rig.json").write_text(json.dumps({"bones": [bone]}))
    output = tmp_path / "out.npz"
    result = call(command.main, "bind", model, tmp_path / name, "-o", output, *flags)
    assert sentence in refused(result)
    assert not output.exists()


@pytest.fixture
def body(make_ball_field, tmp_path):
    """A model of an opaque body: taller than it is wide."""
    fields.save(make_ball_field(0, 0.06, 1.0), tmp_path / "body.npz")
    return tmp_path / "body.npz"


def test_the_rig_of_this_object_is_laid_on_it(call, body, tmp_path):
    make_skin(*ellipsoid([3.0, 3.0, 3.75])).save(tmp_path / "own.glb")
    result = call(command.main, "bind", body, tmp_path / "own.glb", "-o", tmp_path / "out.npz")
    assert result.code == 0 and "2 bones, no clips" in result.out
    share = int(re.search(r"share (\d+)% of the space", result.out)[1])
    assert share >= 80 and "That is little" not in result.out


@pytest.mark.parametrize("sizes", [[0.3, 0.3, 3.0], [3.0, 0.5, 3.0], [4.0, 0.5, 0.5]])
def test_the_rig_of_another_object_is_refused(call, body, tmp_path, refused, sizes):
    make_skin(*ellipsoid(sizes)).save(tmp_path / "other.glb")
    result = call(command.main, "bind", body, tmp_path / "other.glb", "-o", tmp_path / "out.npz")
    assert "other.glb is the rig of another object" in refused(result)
    assert not (tmp_path / "out.npz").exists()


def test_a_rig_that_is_placed_by_hand_is_told_of(call, body, tmp_path):
    make_skin(*ellipsoid([0.1, 0.1, 0.37])).save(tmp_path / "thin.glb")
    matrix = np.eye(4)
    matrix[:3, 3] = 0.5
    placed = ["--transform", *matrix.ravel()]
    output = "-o", tmp_path / "out.npz"
    result = call(command.main, "bind", body, tmp_path / "thin.glb", *output, *placed)
    assert result.code == 0 and "That is little" in result.out


def test_a_fox_is_no_helmet(call, tmp_path, shared_data, refused):
    fox = shared_data("rigs") / "Fox.glb"
    result = call(command.main, "bind", DEFAULT_MODEL, fox, "-o", tmp_path / "out.npz")
    assert "Fox.glb is the rig of another object" in refused(result)


def test_who_made_a_rig_is_kept_with_what_was_known(call, body, tmp_path):
    file = make_skin(*ellipsoid([3.0, 3.0, 3.75]))
    file.parts["asset"]["copyright"] = "Rig by A.\nCC BY 4.0"
    file.save(tmp_path / "own.glb")
    fields.save(fields.load(body), body, {"attribution": "Photographs by B."})
    for source in (body, body):  # the second time it is known
        result = call(command.main, "bind", source, tmp_path / "own.glb", "-o", body)
        assert result.code == 0
        assert fields.load(body).attribution == "Photographs by B.; Rig by A. CC BY 4.0"
    mesh = tmp_path / "mesh.ply"
    assert call(command.main, "export", body, "-o", mesh).code == 0
    header = mesh.read_bytes().partition(b"end_header")[0].decode().splitlines()
    assert "comment Photographs by B.; Rig by A. CC BY 4.0" in header


@pytest.mark.parametrize("value", [7, ["x"], None, ""])
def test_a_copyright_that_is_no_text_is_none(call, body, tmp_path, value):
    file = make_skin(*ellipsoid([3.0, 3.0, 3.75]))
    file.parts["asset"]["copyright"] = value
    file.save(tmp_path / "own.glb")
    output = tmp_path / "out.npz"
    assert call(command.main, "bind", body, tmp_path / "own.glb", "-o", output).code == 0
    assert fields.load(output).attribution == ""


def test_what_a_rig_file_has_more_is_told(call, body, tmp_path):
    file = make_skin(*ellipsoid([3.0, 3.0, 3.75]))
    file.parts["nodes"] += [{"mesh": 1, "skin": 1}]
    few = {"POSITION": file.add(np.ones((3, 3), "<f4"), "VEC3")}
    file.parts["meshes"] += [{"primitives": [{"attributes": few}]}]
    file.parts["skins"] += [{"joints": [0]}]
    file.parts["meshes"][0]["weights"] = [0.5]
    file.save(tmp_path / "more.glb")
    result = call(command.main, "bind", body, tmp_path / "more.glb", "-o", tmp_path / "out.npz")
    assert result.code == 0 and "more.glb: It has 2 skins: Skin, with the most points" in result.out
    assert "more.glb: It has morph targets with weights up to 0.5 at rest" in result.out


@pytest.fixture
def bent_model(model):
    """The model's clip bends the upper bone by a right angle."""
    field = fields.load(model)
    rig = rig_from(field.rig_arrays, field.mesh.vertex_count)
    pose = turned(rig.skeleton, rig.skeleton.rest_pose, 1, [1.6, 0.0, 0.0])
    clip = clip_of_poses("Bend", [0.0, 0.5], [rig.skeleton.rest_pose, pose])
    rig = Rig(rig.skeleton, rig.weights, (*rig.clips, clip))
    fields.save(replace(field, rig_arrays=arrays_of(rig)), model)
    return model


def test_quality_says_where_tets_tear(call, bent_model, tmp_path):
    picture = tmp_path / "worst.png"
    result = call(command.main, "quality", bent_model, "--picture", picture)
    assert result.code == 0
    assert "Nod: 37 frames, smallest volume ratio 1.00, at most 0 inverted" in result.out
    assert "worst: tet" in result.out and "Bend at 0.5 s" in result.out
    with Image.open(picture) as image:
        pixels = np.asarray(image).reshape(-1, 3)
    assert image.size == (960, 480)
    assert (pixels == (230, 60, 40)).all(axis=1).any()  # torn
    mended = call(command.main, "quality", bent_model, "--clip", "Bend", "--untangle")
    assert "at most 0 inverted" in mended.out and "Nod" not in mended.out


def test_quality_needs_a_clip(call, bent_model, refused):
    assert "no clip 'Run'" in refused(call(command.main, "quality", bent_model, "--clip", "Run"))
