"""The add-on in Blender itself, without a window, where a Python with bpy is named.

DEFORMRF_BPY_PYTHON=/path/to/python pytest tests/scenes/test_blender_addon.py
"""

import json
import os
import subprocess

import numpy as np
import pytest
from point_caches import write_cache

from deformrf.core.base.paths import ASSETS, ROOT
from deformrf.core.geometry import a15_grid
from deformrf.core.render import Renderer, preview
from deformrf.wings.rig import (
    VertexClip,
    export_mesh,
    read_blender,
    read_cache,
    rig_of,
    skinning_error,
)

PYTHON = os.environ.get("DEFORMRF_BPY_PYTHON", "")
SCRIPT = ROOT / "tests" / "support" / "blender_rig.py"
ADDON = ASSETS / "blender" / "deformrf_rig.py"
SKIPPED = "needs Blender as a Python package: DEFORMRF_BPY_PYTHON names a Python that imports bpy"
pytestmark = pytest.mark.skipif(not PYTHON, reason=SKIPPED)


@pytest.fixture(scope="module")
def trip(ball, tmp_path_factory):
    """The ball's mesh in Blender and back: a folder of what Blender wrote, and its facts."""
    folder = tmp_path_factory.mktemp("blender")
    given = ball.mesh.rest_vertices + np.random.default_rng().normal(
        scale=0.05, size=(5, *ball.mesh.rest_vertices.shape)
    )
    clip = VertexClip("given", np.arange(5) / 24.0, given.astype(np.float32))
    for ending in (".pc2", ".mdd"):
        write_cache(clip, folder / f"given{ending}")
    mesh = export_mesh(ball.mesh, folder / "ball.ply", preview=preview(ball, Renderer(ball)))
    command = [PYTHON, SCRIPT, ADDON, mesh, folder]
    own = {**os.environ, "BLENDER_USER_RESOURCES": str(folder / "blender")}
    for name in ("PYTHONPATH", "PYTHONHOME"):
        own.pop(name, None)
    run = subprocess.run(command, env=own, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr[-2000:]
    return folder, json.loads((folder / "facts.json").read_text()), clip


def test_the_dialog_installs_it(trip):
    assert trip[1]["installed"]


def test_the_panel_has_the_steps_in_order(trip):
    for time in ("first", "last"):
        written = trip[1][f"{time} panel"]
        assert [text[0] for text in written if text[1:3] == "  "] == list("12345")
        assert written[1] == "deformrf.import_mesh" and "deformrf.export_rig" in written


def test_the_mesh_keeps_its_vertices_and_edges(trip, ball):
    from deformrf.core.geometry import edges

    _, facts, _ = trip
    assert facts["vertices"] == ball.mesh.vertex_count
    assert facts["edges"] == len(edges(ball.mesh.tets))


def test_the_preview_follows_the_tets(trip):
    _, facts, _ = trip
    assert facts["preview moved"] > 0.05
    assert facts["preview error"] < 1e-6


def test_blender_plays_our_caches_to_the_bit(trip):
    folder, _, clip = trip
    for name in ("given.pc2", "given.mdd"):
        np.testing.assert_array_equal(np.load(folder / f"{name}.npy"), clip.vertices)


def test_its_cache_comes_back_to_the_bit(trip, ball):
    folder, _, _ = trip
    clip = read_cache(folder / "rig.pc2", ball.mesh.vertex_count)
    found = read_blender(folder / "rig.npz", ball.mesh)
    np.testing.assert_array_equal(clip.vertices, found.clips[0].vertices)
    np.testing.assert_array_equal(clip.vertices[0], ball.mesh.rest_vertices.astype(np.float32))
    np.testing.assert_allclose(clip.times, found.clips[0].times, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "method"), [("rig.npz", "linear"), ("volume.npz", "dual quaternion")]
)
def test_our_skinning_is_blenders(trip, ball, name, method):
    found = read_blender(trip[0] / name, ball.mesh)
    assert found.method == method
    moved = np.abs(found.clips[0].vertices - ball.mesh.rest_vertices).max()
    assert moved > 0.1
    assert skinning_error(found, found.clips[0], ball.mesh) < 1e-5


def test_bones_and_actions_become_a_rig(trip, ball):
    folder, _, _ = trip
    rig = rig_of(read_blender(folder / "actions.npz", ball.mesh), ball.mesh)
    assert rig.skeleton.names == ("Root", "Middle", "Top")
    assert rig.skeleton.parents.tolist() == [-1, 0, 1]
    np.testing.assert_allclose(rig.skeleton.tails[:2], rig.skeleton.heads[1:], atol=1e-6)
    assert [clip.name for clip in rig.clips] == ["Bend"]
    found = read_blender(folder / "rig.npz", ball.mesh)
    for k in (0, 5, 11):
        matrices = rig.clips[0].matrices_at(rig.skeleton, found.clips[0].times[k])
        np.testing.assert_allclose(matrices, found.clips[0].matrices[k], atol=1e-5)


def test_shape_keys_come_back(trip, ball):
    folder, _, _ = trip
    found = read_blender(folder / "shape.npz", ball.mesh)
    assert len(found.shapes) == 1
    rest = ball.mesh.rest_vertices
    np.testing.assert_allclose(found.shapes[0][:, 0], 0.2 * rest[:, 0], atol=1e-5)
    assert found.clips[0].shape_values[0, 0] == pytest.approx(0.5)
    (clip,) = rig_of(found, ball.mesh).clips
    assert isinstance(clip, VertexClip)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("no mesh", "import a coarse mesh first"),
        ("no file", "No such file"),
        ("cut file", "is cut off"),
        ("no skeleton", "choose an armature"),
        ("unbound", "bind it"),
        ("moved", "1 vertices of"),
        ("no weight", "1 vertices of the surface have no weight"),
        ("added", "vertices were added"),
    ],
)
def test_errors_are_reports_of_one_sentence(trip, what, words):
    sentence = trip[1][what]
    assert words in sentence and sentence.count("\n") == 1


def test_a_rig_of_another_mesh_is_refused(trip):
    with pytest.raises(ValueError, match="belongs to another model"):
        read_blender(trip[0] / "rig.npz", a15_grid(0.25))
