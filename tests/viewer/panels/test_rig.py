"""The section on bones, drawn in a window without a display; and its keys."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from deformrf.wings import rig

pytestmark = pytest.mark.gl


@pytest.fixture
def dancer(ball):
    """The ball with two bones and a clip."""
    ends = [[0.5, 0.5, 0.1], [0.5, 0.5, 0.5]], [[0.5, 0.5, 0.5], [0.5, 0.5, 0.9]]
    skeleton = rig.make_skeleton(["low", "high"], [-1, 0], *ends)
    poses = [skeleton.rest_pose, rig.turned(skeleton, skeleton.rest_pose, 1, (0.8, 0.0, 0.0))]
    clip = rig.clip_of_poses("Dance", [0.0, 0.5], poses)
    made = rig.Rig(skeleton, rig.automatic_weights(ball.mesh, skeleton), (clip,))
    return replace(ball, rig_arrays=rig.arrays_of(made))


@pytest.fixture
def app(window, dancer, monkeypatch, tmp_path):
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    made = App(*window, EventLog(False))
    made.load(dancer, "dancer", "cpu")
    made.scene.settings.fixed_resolution = 0.25
    frames(made, 3)
    yield made
    made.close()


def frames(app, count):
    app.run(app.frame_count + count)
    assert not app.gui._failed


def press(app, name, modifiers=0):
    from pyglet.window import key

    app.window.dispatch_event("on_key_press", getattr(key, name), modifiers)
    app.window.dispatch_events()
    frames(app, 2)


def test_the_section_shows_bones_and_clips_of_the_model_and_what_is_chosen(app, monkeypatch):
    from deformrf.viewer.panels import rig as panel

    lines = []
    app.scene.settings.task = "rig"
    monkeypatch.setattr(panel.imgui, "text_wrapped", lines.append)
    frames(app, 1)
    assert "2 bones" in lines
    app.scene.rigging.selected = 1, "tail"
    for tool in ("joints", "bones"):
        app.scene.settings.tool = tool
        frames(app, 1)
        assert lines[-1] != "2 bones" and "2 bones; chosen: high" in lines
    app.scene.rigging.selected = 0, "head"
    frames(app, 1)
    assert "2 bones; chosen: low, its head" in lines


DRAWN = (
    *("button", "small_button", "radio_button", "checkbox", "combo", "slider_float", "selectable"),
    *("input_text", "input_text_with_hint", "input_int2", "color_edit3", "collapsing_header"),
)


@pytest.mark.parametrize("task", ["bend", "rig", "animate", "film", "view"])
def test_no_two_items_of_a_task_have_one_id(app, monkeypatch, task):
    """A click on the one would be taken for one on the other."""
    from imgui_bundle import imgui

    found = []

    def noted(draw, label, *arguments, **named):
        found.append((imgui.get_id(label), label))
        return draw(label, *arguments, **named)

    for name in DRAWN:
        monkeypatch.setattr(imgui, name, partial(noted, getattr(imgui, name)))
    app.scene.settings.task, app.scene.settings.show_timeline = task, True
    app.scene.timeline.save_pose("pose")
    app.scene.rigging.selected = 1, "tail"
    frames(app, 2)
    found.clear()
    frames(app, 1)
    ids = [one for one, _ in found]
    assert len(ids) > 20 and not [label for one, label in found if ids.count(one) > 1]


def test_keys_play_rest_key_and_save(app):
    from pyglet.window import key

    scene = app.scene
    press(app, "ENTER", key.MOD_SHIFT)
    assert scene.posing.playing and scene.posing.clip == "Dance"
    press(app, "ENTER", key.MOD_SHIFT)
    assert not scene.posing.playing
    press(app, "A", key.MOD_SHIFT)
    np.testing.assert_allclose(
        scene.posing.current.rotations, scene.rigging.skeleton.rest_pose.rotations
    )
    press(app, "C", key.MOD_SHIFT)
    assert "two keys or more" in app.recorder.message
    press(app, "K", key.MOD_SHIFT)
    scene.timeline.scrub(30)
    scene.posing.scrub_clip("Dance", 0.5)
    press(app, "K", key.MOD_SHIFT)
    press(app, "C", key.MOD_SHIFT)
    assert [clip.name for clip in scene.rigging.clips] == ["Dance", "clip 1"]
    press(app, "H", key.MOD_SHIFT)
    assert not scene.settings.show_bones and scene.settings.show_handles


def test_a_copy_of_the_model_has_the_rig_as_it_is(app, tmp_path):
    from deformrf.core.field import load

    app.scene.rigging.name_bone(1, "top")
    app.actions.call("save_model")
    (path,) = tmp_path.glob("model-*.npz")
    model = load(path)
    found = rig.rig_from(model.rig_arrays, model.mesh.vertex_count)
    assert found.skeleton.names == ("low", "top") and found.clips[0].name == "Dance"
    np.testing.assert_allclose(found.weights, app.scene.rigging.rig.weights)


def test_delete_takes_joints_while_they_are_placed_and_keys_otherwise(app):
    scene = app.scene
    press(app, "J")
    press(app, "DELETE")
    assert "click on it" in app.recorder.message
    scene.rigging.selected = 1, "tail"
    press(app, "DELETE")
    assert scene.rigging.bone_count == 1
    press(app, "ESCAPE")
    assert scene.settings.tool == "grab"
    scene.rigging.selected = 0, "tail"
    press(app, "DELETE")
    assert scene.rigging.bone_count == 1
