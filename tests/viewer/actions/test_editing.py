"""What keys and buttons call, without any window."""

from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.core.deform import TIME_STEP
from deformrf.viewer.actions import ACTIONS, action_of
from deformrf.viewer.document import Scene
from deformrf.viewer.tools import Controls
from deformrf.viewer.tools.bend import PAUSED


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


@pytest.fixture
def controls(scene):
    made = Controls(scene, lambda: None, lambda *_, **__: None)
    made.size = 320, 240
    return made


@pytest.fixture
def app_like(scene, controls):
    """What actions need of an App; `said` are its messages."""
    said = []
    recorder = SimpleNamespace(say=said.append)
    parts = {"scene": scene, "controls": controls, "recorder": recorder, "said": said}
    return SimpleNamespace(**parts, takes=SimpleNamespace(asking=False))


def test_escape_closes_the_help(app_like):
    app_like.scene.settings.show_help = True
    ACTIONS["cancel"](app_like)
    assert not app_like.scene.settings.show_help


def test_undo_and_redo_say_what_they_did(app_like):
    scene, said = app_like.scene, app_like.said
    ACTIONS["undo"](app_like)
    assert said == ["nothing to undo"]
    scene.set_ground(True)
    ACTIONS["undo"](app_like)
    assert said[-1] == "undone: ground" and not scene.on_ground
    ACTIONS["redo"](app_like)
    assert said[-1] == "done again: ground" and scene.on_ground
    ACTIONS["redo"](app_like)
    assert said[-1] == "nothing to do again"


def test_specks_are_deleted_by_their_action(app_like):
    ACTIONS["delete_specks"](app_like)
    assert app_like.said == ["nothing to delete there"]


def test_undo_in_the_middle_of_a_drag_lets_go(controls, scene, app_like):
    before = scene.solver.vertices.numpy().copy()
    vertex = int(scene.handles.control_ids[0])
    controls.grab(vertex)
    scene.handles.drag_to(scene.handles.grabbed.target.place + np.array([0.1, 0.0, 0.0]))
    scene.clock.advance(TIME_STEP)
    assert scene.handles.grabbed is not None
    ACTIONS["undo"](app_like)
    assert scene.handles.grabbed is None and controls.mode == ""
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), before)


def test_undo_in_the_middle_of_a_drag_takes_back_the_drag_alone(controls, scene, app_like):
    scene.set_ground(True)
    for _ in range(2):
        controls.grab(int(scene.handles.control_ids[0]))
        scene.clock.advance(TIME_STEP)
        ACTIONS["undo"](app_like)
        assert scene.handles.grabbed is None and app_like.said[-1] == "undone: drag"
        assert scene.on_ground and scene.journal.undoes == "ground"
    ACTIONS["undo"](app_like)
    assert app_like.said[-1] == "undone: ground" and not scene.on_ground


@pytest.mark.parametrize(
    "action, towards", [("front", (0, 1, 0)), ("right", (-1, 0, 0)), ("above", (0, 0, -1))]
)
def test_the_camera_looks_along_an_axis(app_like, controls, action, towards):
    target = app_like.scene.orbit.target.copy()
    ACTIONS[action](app_like)
    assert controls.camera.forward == pytest.approx(towards, abs=0.02)
    np.testing.assert_array_equal(app_like.scene.orbit.target, target)


@pytest.mark.parametrize("mode, told", [("physics", [PAUSED]), ("pose", [])])
def test_a_drag_while_paused_says_why_nothing_moves(controls, scene, mode, told):
    said = []
    controls.say = said.append
    scene.settings.hand, scene.clock.paused = mode, True
    controls.grab(int(scene.handles.control_ids[0]))
    assert said == told


def test_n_switches_between_physics_and_pose(app_like, scene):
    assert action_of("N") == "pose" and not ACTIONS["pose"].is_on(app_like)
    ACTIONS["pose"](app_like)
    assert scene.settings.hand == "pose" and ACTIONS["pose"].is_on(app_like)
    ACTIONS["undo"](app_like)
    assert scene.settings.hand == "physics"


def test_a_task_takes_its_tool_and_a_tool_shows_its_task(app_like, scene):
    settings = scene.settings
    ACTIONS["task_rig"](app_like)
    assert settings.tool == "joints"  # there are no bones yet
    ACTIONS["toggle_push"](app_like)
    assert settings.task == "bend"
    ACTIONS["bones"](app_like)
    assert settings.task == "rig"
    ACTIONS["task_bend"](app_like)
    assert settings.tool == "grab" and settings.task == "bend"
    ACTIONS["task_animate"](app_like)
    ACTIONS["bones"](app_like)
    assert settings.task == "animate" and settings.show_timeline  # whose keys the bones get
    scene.rigging.add_joint(np.array([0.5, 0.5, 0.2]))
    scene.rigging.add_joint(np.array([0.5, 0.5, 0.8]))
    ACTIONS["grab"](app_like)
    ACTIONS["task_rig"](app_like)
    assert settings.tool == "bones"
