"""What a user does with the tool, from selecting to the film, in a real X window."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from xwindow import LiveViewer, missing_tools, screen

from deformrf.viewer.document import load_session

pytestmark = [pytest.mark.e2e, pytest.mark.gl]


@pytest.fixture(scope="module")
def display(tmp_path_factory, give_up_window):
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    with screen(tmp_path_factory.mktemp("screen")) as made:
        yield made


@pytest.fixture
def start(display, ball_file, tmp_path):
    """A function that starts the viewer; all are ended after the test."""
    started = []

    def made(*arguments):
        viewer = LiveViewer(display, ball_file, tmp_path, "--size", "1000x700", *arguments)
        started.append(viewer)
        return viewer

    yield made
    for viewer in started:
        viewer.end()


def free(viewer):
    """Red points in sight that no panel covers: their ids, and where they are."""
    entries = [e for e in viewer.state()["vertices"] if 80 < e["at"][0] < 680 and e["at"][1] > 60]
    return [e["id"] for e in entries], np.array([e["at"] for e in entries])


def until(viewer, condition, what, seconds=20):
    """Wait for a state; returns it."""
    viewer.wait(lambda: condition(viewer.state()), seconds, what)
    return viewer.state()


def test_select_drag_undo_redo_pin_key_scrub_save_replay_and_film(start, ball, tmp_path):
    viewer = start()
    ids, at = free(viewer)
    low, high = at.min(axis=0) - 12, at.max(axis=0) + 12
    viewer.tool("key", "b")
    viewer.drag(low, high - low)
    selected = until(viewer, lambda s: len(s["selected"]) > 3, "some are selected")["selected"]
    assert len(set(selected) & set(ids)) > 3

    # The selection is dragged along x, and that is undone and done again.
    held = next(one for one in selected if one in ids)
    place = at[ids.index(held)]
    viewer.drag(place, (40, 0), release=False)
    viewer.tool("key", "x")
    viewer.drag(place + np.array([40, 0]), (10, -30), press=False, release=False)
    bent = until(viewer, lambda s: s["max_displacement"] > 0.03, "it is bent")
    assert bent["undoes"] == "drag"
    viewer.tool("key", "p")  # it stays there
    until(viewer, lambda s: s["pinned"] > bent["pinned"], "what was held is pinned")
    viewer.tool("mouseup", 1)
    kept = viewer.next_state()["max_displacement"]
    assert kept > 0.03
    viewer.tool("key", "ctrl+z", "ctrl+z")
    until(viewer, lambda s: s["max_displacement"] < 1e-3, "the drag is undone")
    viewer.tool("key", "ctrl+shift+z", "ctrl+shift+z")
    until(viewer, lambda s: s["max_displacement"] > 0.9 * kept, "it is done again")

    # Two keys of the timeline, and the playhead goes back to the first.
    viewer.tool("key", "shift+o")
    until(viewer, lambda s: "turntable" in s["undoes"], "there is a turntable")
    viewer.tool("key", "Next")
    later = until(viewer, lambda s: s["playhead"] > 0, "the playhead is at a later key")
    viewer.tool("key", "Prior")
    until(viewer, lambda s: s["playhead"] < later["playhead"], "the playhead is back")

    viewer.find("export session")
    path = viewer.wait(lambda: viewer.last("written"), 20, "the session is written")["path"]
    last = viewer.next_state()
    viewer.tool("key", "ctrl+q")
    assert viewer.process.wait(20) == 0
    assert len(load_session(path, ball).events) > 10

    again = start("--session", path)
    state = until(again, lambda s: s["max_displacement"] > 0.0, "the session was played")
    assert state["max_displacement"] == pytest.approx(last["max_displacement"], abs=2e-3)
    assert state["pinned"] == last["pinned"]
    again.end()

    film = tmp_path / "film.mp4"
    command = [
        sys.executable,
        "-c",
        "from deformrf.commands.render import main; main()",
    ]
    options = ["--session", path, "-o", film, "--size", "64x48", "--fps", "5", "--device", "cpu"]
    model = tmp_path / "model.npz"
    model.write_bytes(again.model.read_bytes())
    done = subprocess.run([*command, model, *options], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert film.stat().st_size > 500


def test_a_bad_file_is_refused_in_a_dialog_and_the_scene_stays(start, tmp_path):
    bad = tmp_path / "bad.npz"
    bad.write_bytes(b"PK\x03\x04 no model")
    viewer = start()
    viewer.tool("key", "ctrl+o")
    until(viewer, lambda s: s["dialog"], "the dialog is open")
    viewer.tool("key", "ctrl+a")
    viewer.tool("type", str(bad))
    time.sleep(0.5)
    viewer.tool("key", "Return")
    state = until(viewer, lambda s: "bad.npz" in (s["dialog"] or ""), "it says what is wrong")
    viewer.tool("key", "Escape")
    until(viewer, lambda s: s["dialog"] is None, "the dialog is closed")
    _, at = free(viewer)
    viewer.drag(at[0], (30, 10))
    viewer.wait(lambda: viewer.last("release"), 10, "the object can be dragged")
    assert state["vertices"] and viewer.process.poll() is None


def test_after_a_kill_the_session_is_offered_and_goes_on(start):
    viewer = start()
    _, at = free(viewer)
    viewer.tool("key", "t")  # rest here changes nothing; gravity does
    viewer.drag(at[0], (40, 0), release=False)
    viewer.tool("key", "p")
    viewer.tool("mouseup", 1)
    pinned = until(viewer, lambda s: s["undoes"] == "pin what was held", "it is pinned")["pinned"]
    time.sleep(7.0)
    os.kill(viewer.process.pid, signal.SIGKILL)
    viewer.process.wait()

    again = start()
    assert again.state()["pinned"] < pinned
    again.press("Go on with it")
    until(again, lambda s: s["pinned"] == pinned, "the session goes on")
