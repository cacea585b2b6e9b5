"""What was saved together opens together, in a real X window."""

import shutil

import pytest
import rig_hand as hand
from xwindow import LiveViewer, missing_tools, screen

from deformrf.core.base.paths import DEFAULT_MODEL

pytestmark = [pytest.mark.e2e, pytest.mark.gl]
JOINTS = (500, 560), (500, 460), (500, 200)  # points: the stand's foot, the neck, the goggles


@pytest.fixture
def start(tmp_path, give_up_window):
    """A function that starts the viewer on one screen."""
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    (tmp_path / "screen").mkdir()
    made = []
    with screen(tmp_path / "screen") as display:

        def begin(model, *arguments):
            made.append(LiveViewer(display, model, tmp_path, "--size", "1000x700", *arguments))
            return made[-1]

        yield begin
        for viewer in made:
            viewer.end()


def test_a_copy_with_a_rig_and_its_session_open_together(start, tmp_path):
    """The session began with the model before it had bones; nothing of it is lost."""
    shutil.copy(DEFAULT_MODEL, tmp_path / "own.npz")
    viewer = start(tmp_path / "own.npz")
    viewer.move(600, 640)
    hand.key(viewer, "Tab")  # no panel in the way
    hand.take(viewer, "joints", "j")
    joints = hand.place_joints(viewer, JOINTS)
    hand.take(viewer, "bones", "a")
    hand.drag_joint(viewer, 1, (60, 30))
    assert viewer.state()["undoes"] == "pose a bone"
    copy = tmp_path / hand.written(viewer, "export model", 1)
    session = tmp_path / hand.written(viewer, "export session", 2)
    bent = viewer.next_state()["max_displacement"]
    viewer.tool("key", "ctrl+q")  # all of it is saved: nothing is asked
    assert viewer.process.wait(20) == 0
    viewer = start(copy, "--session", str(session))
    state = viewer.next_state()
    assert len(state["joints"]) == len(joints) and state["undoes"] == "pose a bone"
    assert state["max_displacement"] == pytest.approx(bent, rel=0.05)
    viewer.tool("key", "ctrl+q")
    assert viewer.process.wait(20) == 0
