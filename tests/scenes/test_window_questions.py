"""What is asked before the end, and dialogs, in a real X window."""

import json
import signal
import time
import zipfile

import pytest
from xwindow import LiveViewer, missing_tools, screen

pytestmark = [pytest.mark.e2e, pytest.mark.gl]

SIZE = "1000x700"
BESIDE = 620, 640  # the object, in a window of that size


@pytest.fixture(scope="module")
def display(tmp_path_factory, give_up_window):
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    with screen(tmp_path_factory.mktemp("screen")) as made:
        yield made


@pytest.fixture
def start(display, ball_file, tmp_path):
    """A function that starts the viewer; all of a test's have one folder."""
    made = []

    def begin():
        made.append(LiveViewer(display, ball_file, tmp_path, "--size", SIZE))
        return made[-1]

    yield begin
    for viewer in made:
        viewer.end()


def asked(viewer, question):
    viewer.wait(lambda: viewer.next_state()["question"] == question, 20, f"{question!r} is asked")


def bend(viewer):
    _, place = viewer.vertex()
    viewer.drag(place, (30, -20))
    viewer.wait(lambda: viewer.state()["undoes"] == "drag", 10, "it is bent")


def kept(folder):
    """Names of the edits of the session that is kept for another start."""
    (path,) = (folder / "state" / "deformrf" / "sessions").glob("*.jsonl")
    return [json.loads(line)[1] for line in path.read_text().splitlines()[1:]]


def test_fields_dialogs_and_the_question_before_the_end(start, tmp_path):
    viewer = start()
    before = viewer.state()["young_modulus"]
    for text in ("nan", "inf", "1e999"):
        viewer.move(*viewer.place("##stiffness"))
        viewer.tool("keydown", "ctrl", "click", 1, "keyup", "ctrl")
        time.sleep(0.4)
        viewer.tool("type", text)
        viewer.tool("key", "Return")
    assert viewer.next_state()["young_modulus"] == before
    bend(viewer)
    viewer.tool("key", "ctrl+o")
    asked(viewer, "dialog")
    for name in ("absent rp.npz", "rpr dku.npz"):  # R would reset, Space and P pause and pin
        viewer.tool("type", name)
        viewer.tool("key", "Return")
        time.sleep(0.4)
    state = viewer.next_state()
    assert state["question"] == "dialog"
    viewer.tool("key", "Escape")
    asked(viewer, "")
    for name in ("undoes", "paused", "pinned", "tool", "playhead"):
        assert state[name] == viewer.state()[name]
    assert (state["undoes"], state["paused"], state["tool"]) == ("drag", False, "grab")

    viewer.tool("key", "ctrl+q")
    asked(viewer, "leaving")
    viewer.tool("key", "ctrl+q", "r", "space")
    viewer.ask_to_close()
    viewer.drag(BESIDE, (-60, 20))
    after = viewer.next_state()
    assert after["question"] == "leaving" and after["undoes"] == "drag" and not after["paused"]
    assert after["yaw"] == state["yaw"] and viewer.events("orbit") == []
    viewer.tool("key", "Escape")
    asked(viewer, "")
    viewer.ask_to_close()
    asked(viewer, "leaving")
    viewer.press("Quit without saving")
    assert viewer.process.wait(20) == 0
    assert not list(tmp_path.glob("*.jsonl")) and not list(tmp_path.glob("state/*/sessions/*"))


def test_enter_saves_beside_what_was_opened(start, ball_file, tmp_path):
    viewer = start()
    bend(viewer)
    viewer.tool("key", "ctrl+q")
    asked(viewer, "leaving")
    viewer.tool("key", "Return")
    assert viewer.process.wait(20) == 0
    path = ball_file.with_suffix(".deformrf")
    assert "grab" in zipfile.ZipFile(path).read("session.jsonl").decode() and not list(
        tmp_path.glob("state/*/sessions/*")
    )
    path.unlink()


def test_signals_keep_the_session_and_the_next_start_offers_it(start, tmp_path):
    viewer = start()
    bend(viewer)
    viewer.process.send_signal(signal.SIGTERM)
    assert viewer.process.wait(20) == 130
    assert "grab" in kept(tmp_path)
    viewer = start()
    assert viewer.state()["question"] == "recovery"
    viewer.tool("key", "r", "Return")  # go on with it
    viewer.wait(lambda: viewer.state()["undoes"] == "drag", 20, "it goes on")
    asked(viewer, "")
    viewer.process.send_signal(signal.SIGHUP)
    assert viewer.process.wait(20) == 130
    assert "grab" in kept(tmp_path)
    viewer = start()
    viewer.tool("key", "Escape")  # ask again at another start
    asked(viewer, "")
    viewer.tool("key", "ctrl+q")
    assert viewer.process.wait(20) == 0
    assert "grab" in kept(tmp_path)
