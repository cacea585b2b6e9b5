"""The gizmo, free drags and the choice of keys in a window without a display; any inputs."""

import numpy as np
import pytest
import rig_hand as hand
from random_hands import Inputs
from xwindow import LiveViewer, missing_tools, screen

from deformrf.core.base.paths import BUNDLED
from deformrf.viewer import preferences
from deformrf.viewer.document import Player, Scene, load_session, save_session

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    made = App(*window, EventLog(False))
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.25
    frames(made, 2)
    yield made
    assert not made.gui._failed
    made.close()


def frames(app, count):
    app.run(app.frame_count + count)


def send(app, name, *arguments):
    app.window.dispatch_event(name, *arguments)
    app.window.dispatch_events()


def press(app, *names):
    from pyglet.window import key

    for name in names:
        send(app, "on_key_press", getattr(key, name), 0)
        if name.startswith("_"):
            send(app, "on_text", name[1:])


def test_enter_and_digits_are_the_free_drags_and_keys_again_afterwards(app):
    scene, controls = app.scene, app.controls
    scene.settings.keys, scene.settings.show_panel = "blender", False
    press(app, "A", "G", "Z", "_1", "PERIOD", "BACKSPACE", "BACKSPACE", "PERIOD")
    assert controls.held_drag.held.text == "" and controls.free  # a period comes as text
    send(app, "on_text", ".1")
    frames(app, 2)
    way = scene.handles.grabbed.reached.place - scene.handles.grabbed.start
    assert way == pytest.approx([0.0, 0.0, 0.1 * scene.size], abs=1e-6)
    yaw = scene.orbit.yaw
    press(app, "_3")
    assert scene.orbit.yaw == yaw and controls.held_drag.held.text == ".13"
    press(app, "ENTER")
    assert not controls.free and not scene.timeline.playing
    press(app, "_3")
    assert scene.orbit.yaw != yaw


def test_a_free_drag_has_the_mouse_also_over_the_panel(app):
    from pyglet.window import mouse

    scene, controls = app.scene, app.controls
    scene.handles.select(scene.handles.control_ids[:2])
    left, top, right, bottom = app.gui._rectangles[0]
    inside = round(0.5 * (left + right)), app.window.height - 1 - round(0.5 * (top + bottom))
    send(app, "on_mouse_motion", *inside, 0, 0)
    before = scene.orbit
    controls.turn_into("move")
    target = scene.handles.grabbed.target.place
    send(app, "on_mouse_motion", inside[0] + 20, inside[1], 20, 0)
    assert (scene.handles.grabbed.target.place != target).any()
    send(app, "on_mouse_press", inside[0] + 20, inside[1], mouse.LEFT, 0)
    send(app, "on_mouse_release", inside[0] + 20, inside[1], mouse.LEFT, 0)
    assert not controls.free and scene.handles.grabbed is None and scene.orbit is before
    frames(app, 2)
    send(app, "on_mouse_press", *inside, mouse.LEFT, 0)
    assert controls.mode == ""  # the panel has it again
    send(app, "on_mouse_release", *inside, mouse.LEFT, 0)


def test_a_free_drag_from_a_menu_begins_where_the_mouse_is(app):
    from deformrf.viewer.actions import ACTIONS

    scene, controls = app.scene, app.controls
    scene.handles.select(scene.handles.control_ids[:2])
    send(app, "on_mouse_motion", 100, app.window.height - 5, 0, 0)  # on the menu bar
    assert app.gui.mouse_on_panel
    frames(app, 2)
    ACTIONS["move"](app)
    start = scene.handles.grabbed.target.place
    send(app, "on_mouse_motion", 101, app.window.height - 5, 1, 0)
    way = np.linalg.norm(scene.handles.grabbed.target.place - start)
    assert 0.0 < way < 0.05 * scene.size
    ACTIONS["bones"](app)  # another tool
    assert not controls.mode and scene.handles.grabbed is None


def offered(app):
    from deformrf.viewer.panels.menu import offers_keys

    return offers_keys(app.preferences, app.scene.settings)


@pytest.mark.parametrize("answer", ["keys_blender", "keys_deformrf"])
def test_keys_are_offered_until_they_are_chosen_if_that_is_kept(app, tmp_path, answer):
    from deformrf.viewer.actions import ACTIONS

    settings = app.scene.settings
    assert not offered(app)  # nothing is kept: a script, a test
    app.preferences.path = tmp_path / "preferences.json"
    assert offered(app)
    frames(app, 2)
    ACTIONS[answer](app)
    assert not offered(app) and settings.keys == answer.removeprefix("keys_")
    kept, problem = preferences.load(app.preferences.path)
    assert (kept.keys, kept.has_chosen_keys, problem) == (settings.keys, True, "")


def test_any_inputs_raise_nothing_and_play_again_to_the_bit(app, ball, tmp_path):
    """On a ball with two bones."""
    random = np.random.default_rng()
    rigging = app.scene.rigging
    for height in (0.2, 0.5, 0.8):
        rigging.add_joint(np.array([0.5, 0.5, height]))
    any_hand = Inputs(app, random)
    app.scene.settings.show_panel = False  # its fields would take the keys
    for _ in range(300):
        any_hand.act()
        app.frame(float(random.uniform(0.0, 0.03)))
    app.controls.cancel()
    scene, path = app.scene, tmp_path / "s.jsonl"
    session = load_session(save_session(scene, app.session_start, path), ball)
    other = Scene(ball, "ball", "cpu")
    Player(other, session).play_to(session.ticks)
    np.testing.assert_array_equal(other.solver.vertices.numpy(), scene.solver.vertices.numpy())
    assert other.journal.events == scene.journal.events


@pytest.mark.e2e
def test_a_hand_poses_the_fox_with_the_gizmo_and_keys_it(tmp_path, give_up_window):
    """In a window, with Blender's keys, which the first start offers."""
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    (tmp_path / "own").mkdir()
    with screen(tmp_path) as display:
        viewer = LiveViewer(display, BUNDLED["fox"], tmp_path / "own", "--size", "1000x700")
        try:
            _pose_and_key(viewer)
        finally:
            viewer.end()
    (kept,) = (tmp_path / "own" / "config").rglob("preferences.json")
    assert preferences.load(kept)[0].keys == "blender"


def _pose_and_key(viewer):
    viewer.press("Blender's")
    viewer.wait(lambda: viewer.next_state()["keys"] == "blender", 20, "the keys are Blender's")
    for name in ("Tab", "q", "ctrl+Tab"):  # no panel, rings, and bones
        hand.key(viewer, name)
    viewer.wait(lambda: viewer.next_state()["tool"] == "bones", 20, "bones are posed")
    viewer.click(*hand.joint_at(viewer, 4))
    rings = viewer.wait(lambda: viewer.next_state()["gizmo"], 20, "there is a gizmo")
    assert set(rings) == {"x", "y", "z", "view"}
    still = hand.joint_at(viewer, 4)
    joints = np.array([joint["at"] for joint in viewer.state()["joints"]])
    away = {name: np.linalg.norm(joints - at, axis=1).min() for name, at in rings.items()}
    viewer.drag(rings[max(away, key=away.get)], (25, -25))
    turned = viewer.next_state()
    assert turned["undoes"] == "pose a bone" and turned["max_displacement"] > 0.02
    hand.key(viewer, "k")
    viewer.wait(lambda: "key" in viewer.next_state()["undoes"], 20, "a key is there")
    for name in ("r", "y", "4", "5", "Return"):
        hand.key(viewer, name)
    assert viewer.next_state()["undoes"] == "pose a bone"
    assert np.linalg.norm(hand.joint_at(viewer, 4) - still) > 10.0
    hand.key(viewer, "ctrl+z")
    hand.key(viewer, "ctrl+z")
    hand.key(viewer, "ctrl+z")
    assert viewer.next_state()["max_displacement"] == 0.0
