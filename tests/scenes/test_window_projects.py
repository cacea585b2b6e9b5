"""A project is saved, moved, opened and saved again, in a real X window."""

import shutil

import numpy as np
import pytest
from xwindow import LiveViewer, missing_tools, screen

from deformrf.viewer.document import load_project

pytestmark = [pytest.mark.e2e, pytest.mark.gl]


@pytest.fixture
def start(ball_file, tmp_path, give_up_window):
    """A function that starts the viewer on one screen, by default with a model."""
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    (tmp_path / "screen").mkdir()
    made = []
    with screen(tmp_path / "screen") as display:

        def begin(file=ball_file):
            made.append(LiveViewer(display, file, tmp_path, "--size", "1000x700"))
            return made[-1]

        yield begin
        for viewer in made:
            viewer.end()


def asked(viewer, question):
    viewer.wait(lambda: viewer.next_state()["question"] == question, 20, f"{question!r} is asked")


def save_as(viewer, path):
    """Type a path into the dialog that Ctrl+Shift+S opens, and enter it."""
    viewer.tool("key", "ctrl+shift+s")
    asked(viewer, "dialog")
    viewer.tool("key", "ctrl+a")
    viewer.tool("type", str(path))
    viewer.tool("key", "Return")


def quit(viewer):
    """All of it is saved: nothing is asked."""
    viewer.tool("key", "ctrl+q")
    assert viewer.process.wait(20) == 0


def events_of(path):
    return [event.name for event in load_project(path).session.events]


def test_a_project_is_moved_opened_and_saved_where_it_is(start, tmp_path):
    viewer = start()
    viewer.press("stays")  # what is bent stays so
    viewer.drag(viewer.vertex()[1], (40, -30))
    viewer.wait(lambda: viewer.state()["undoes"] == "drag", 10, "it is bent")
    viewer.tool("key", "shift+k")
    viewer.wait(lambda: viewer.next_state()["undoes"] != "drag", 10, "it is keyed")
    viewer.wait(lambda: not viewer.next_state()["moving"], 40, "it is at rest")
    (tmp_path / "first").mkdir()
    save_as(viewer, tmp_path / "first" / "bent")  # the ending is added
    asked(viewer, "")
    before = viewer.next_state()
    quit(viewer)
    made = events_of(tmp_path / "first" / "bent.deformrf")
    assert before["max_displacement"] > 0.05

    shutil.move(tmp_path / "first", tmp_path / "moved")
    moved = tmp_path / "moved" / "bent.deformrf"
    viewer = start(moved)
    state = viewer.next_state()
    assert state["undoes"] == before["undoes"] and state["question"] == ""
    assert state["max_displacement"] == pytest.approx(before["max_displacement"], rel=0.02)
    assert np.isclose([state["yaw"], state["distance"]], [before["yaw"], before["distance"]]).all()
    viewer.move(300, 640)
    viewer.tool("key", "b")
    viewer.wait(lambda: viewer.next_state()["tool"] == "box", 10, "a box selects")
    viewer.drag((80, 60), (580, 560))
    viewer.wait(lambda: len(viewer.next_state()["selected"]) > 3, 10, "points are selected")
    viewer.tool("key", "b")
    viewer.tool("key", "ctrl+z")
    viewer.wait(lambda: viewer.next_state()["undoes"] == "drag", 10, "the key is undone")
    viewer.tool("key", "ctrl+z")
    viewer.wait(lambda: viewer.next_state()["undoes"] != "drag", 10, "the drag is undone")
    assert viewer.next_state()["max_displacement"] < 0.5 * before["max_displacement"]
    viewer.tool("key", "ctrl+s")
    viewer.wait(lambda: events_of(moved) != made, 20, "the moved file is written")
    quit(viewer)
    assert not (tmp_path / "first").exists() and not list(tmp_path.glob("*.deformrf"))
    assert not list(tmp_path.glob("state/*/sessions/*"))


def test_save_as_replaces_a_file_when_asked_twice(start, tmp_path):
    there = tmp_path / "there.deformrf"
    there.write_text("another one's")
    viewer = start()
    viewer.drag(viewer.vertex()[1], (30, -20))
    viewer.wait(lambda: viewer.state()["undoes"] == "drag", 10, "it is bent")
    save_as(viewer, there)
    assert viewer.next_state()["question"] == "dialog"
    assert there.read_text() == "another one's"
    viewer.tool("key", "Escape")
    asked(viewer, "")
    save_as(viewer, there)  # another dialog asks again
    assert viewer.next_state()["question"] == "dialog"
    assert there.read_text() == "another one's"
    viewer.tool("key", "Return")
    asked(viewer, "")
    assert "grab" in events_of(there)
    viewer.tool("key", "ctrl+shift+s")  # the project that is open is a file that is there, too
    asked(viewer, "dialog")
    viewer.tool("key", "Escape")
    asked(viewer, "")
    quit(viewer)
