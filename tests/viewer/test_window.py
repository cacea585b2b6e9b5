"""The program in a real X window, driven by xdotool as by a user's hand."""

import time
from pathlib import Path

import numpy as np
import pytest
from xwindow import LiveViewer, missing_tools, screen

pytestmark = [pytest.mark.e2e, pytest.mark.gl]
BESIDE = 620, 640  # the object, in a window of 1000 x 700


@pytest.fixture(scope="module")
def display(tmp_path_factory, give_up_window):
    if missing_tools():
        give_up_window(f"needs {' and '.join(missing_tools())}")
    with screen(tmp_path_factory.mktemp("screen")) as made:
        yield made


@pytest.fixture
def session(display, ball_file, tmp_path):
    made = LiveViewer(display, ball_file, tmp_path, "--size", "1000x700")
    yield made
    made.end()


def test_dragging_a_vertex_bends_the_object_and_lets_it_spring_back(session):
    before = session.pixels()
    vertex, start = session.vertex()
    way = np.array([45.0, -35.0])
    session.drag(start, way, release=False)
    grabbed = session.last("grab")
    assert grabbed["vertex"] == vertex
    held = session.next_state()
    assert np.linalg.norm(session.position_of(vertex) - (start + way)) < 2.5
    assert held["max_displacement"] > 0.03
    assert held["max_pin_displacement"] < 1e-6
    session.wait(lambda: session.state()["refined"] == 1, 60, "the bent picture is refined")

    bent = session.pixels()
    changed = (abs(bent.astype(int) - before) > 24).any(axis=-1)
    left, top = np.maximum(np.minimum(start, start + way).astype(int) - 40, 0)
    right, bottom = np.maximum(start, start + way).astype(int) + 40
    assert changed[top:bottom, left:right].mean() > 0.05
    assert not changed[30:640, 60:120].any()  # background, far from the object

    session.tool("mouseup", 1)
    time.sleep(5.0)
    after = session.next_state()
    assert session.last("release")["vertex"] == vertex
    assert after["max_displacement"] < 0.01
    assert after["max_pin_displacement"] < 1e-6


def test_dragging_beside_the_object_orbits(session):
    before = session.state()
    session.drag(BESIDE, (-60, 20))
    after = session.next_state()
    assert after["yaw"] != before["yaw"]
    assert session.events("grab") == []
    assert after["max_displacement"] < 1e-6
    assert session.last("orbit")["yaw"] == pytest.approx(after["yaw"])


def test_the_panel_keeps_its_clicks_wheel_and_drags(session):
    before = session.state()
    session.move(850, 600)
    for button in (4, 5, 4, 4):  # the wheel
        session.tool("click", button)
    x, y = session.place("##stiffness")
    session.drag((x, y), (-300, 100), release=False)
    session.drag((x, y), (500, 100), press=False)
    after = session.next_state()
    assert after["young_modulus"] > 10 * before["young_modulus"]
    for name in ("yaw", "pitch", "distance"):
        assert after[name] == before[name]
    assert session.events("grab", "orbit", "zoom") == []


def test_the_wheel_over_the_view_zooms(session):
    before = session.state()["distance"]
    session.move(380, 350)
    session.tool("click", 4)
    assert session.next_state()["distance"] < before


def test_the_camera_flies_and_looks_along_axes(session):
    session.move(380, 350)
    session.tool("key", "shift+3")
    session.wait(lambda: session.state()["yaw"] == pytest.approx(-np.pi / 2), 5, "the left side")
    before = session.next_state()["distance"]
    session.tool("key", "g")
    session.tool("keydown", "s")
    session.wait(lambda: session.state()["distance"] > 1.2 * before, 10, "the eye is farther away")
    session.tool("keyup", "s")
    session.tool("key", "Escape")
    yaw = session.next_state()["yaw"]
    session.drag(BESIDE, (-60, 20))  # the mouse orbits again
    assert session.next_state()["yaw"] != yaw


def test_resizing_keeps_the_vertices_under_the_mouse(session):
    window = session.tool("search", "--name", "deformrf: ball").split()[-1]
    session.tool("windowsize", window, 820, 560)
    session.wait(lambda: session.state()["size"] == [820, 560], 10, "the window is smaller")
    assert session.last("resize")["size"] == [820, 560]
    state = session.next_state()
    assert state["framebuffer"] == [820, 560]
    vertex, start = session.vertex()
    session.drag(start, (30, 0))
    session.wait(lambda: session.last("release"), 10, "the vertex is let go")
    assert session.last("grab")["vertex"] == session.last("release")["vertex"] == vertex


def test_a_clip_of_the_window_and_a_clean_end(session, tmp_path):
    import av

    session.tool("key", "shift+F9")
    time.sleep(2.0)
    session.tool("key", "shift+F9", "F2")
    session.wait(lambda: len(session.events("written")) == 2, 20, "clip and picture are written")
    (clip,), (picture,) = tmp_path.glob("*.mp4"), tmp_path.glob("*.png")
    assert picture.stat().st_size > 1000
    with av.open(str(clip)) as container:
        stream = container.streams.video[0]
        count = sum(1 for _ in container.decode(video=0))
        assert (stream.width, stream.height) == (1000, 700)
        assert count / 30 == pytest.approx(float(stream.duration * stream.time_base))
        assert 1.5 < count / 30 < 4.0
    session.tool("key", "Escape")
    time.sleep(0.3)
    assert session.process.poll() is None
    session.tool("key", "ctrl+q")
    assert session.process.wait(20) == 0


def test_a_viewer_that_is_closed_while_a_film_is_rendered(session, tmp_path):
    """The film ends where it is, which its name says: no broken file is left."""
    import av

    session.tool("key", "F9")
    time.sleep(5.0)  # of film, so that it takes longer than what follows
    session.tool("key", "F9")
    session.wait(lambda: session.next_state()["question"] == "film", 20, "the choices are asked")
    session.tool("key", "Return")
    session.wait(lambda: session.events("film"), 20, "the film is begun")
    path = Path(session.events("film")[0]["path"])
    time.sleep(3.0)
    session.tool("key", "ctrl+q")
    session.wait(lambda: session.next_state()["question"] == "leaving", 20, "it is asked")
    session.press("Stop it and quit")
    assert session.process.wait(60) == 0
    left = {p.name for p in tmp_path.iterdir() if p.name.startswith((path.stem, f".{path.stem}"))}
    short = f"{path.stem} (cut short).mp4"
    assert left <= {short, f"{path.stem}.jsonl"}
    if short in left:
        with av.open(str(tmp_path / short)) as container:
            assert sum(1 for _ in container.decode(video=0)) >= 1


def test_the_window_closes_as_the_window_manager_asks(session):
    session.ask_to_close()
    assert session.process.wait(20) == 0
