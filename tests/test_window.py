"""The program in a real X window, driven by xdotool as by a user's hand."""

import json
import os
import shutil
import struct
import subprocess
import sys
import time

import numpy as np
import pytest

pytestmark = [pytest.mark.e2e, pytest.mark.gl]
NEEDED = ("Xvfb", "xdotool")


@pytest.fixture(scope="module")
def display(tmp_path_factory, give_up_window):
    """An X server of our own: its name, and the file with its pixels."""
    missing = [tool for tool in NEEDED if not shutil.which(tool)]
    if missing:
        give_up_window(f"needs {' and '.join(missing)}")
    folder = tmp_path_factory.mktemp("screen")
    reading, writing = os.pipe()
    server = subprocess.Popen(
        [
            *("Xvfb", "-displayfd", str(writing), "-screen", "0", "1200x900x24"),
            *("-noreset", "-fbdir", str(folder)),
        ],
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    with os.fdopen(reading) as stream:
        name = ":" + stream.readline().strip()
    yield name, folder / "Xvfb_screen0"
    server.terminate()
    server.wait()


class Session:
    """deformrf-view in a window, and a hand on mouse and keyboard."""

    def __init__(self, display, model, folder, *arguments):
        name, self._screen = display
        # Sessions that are kept go into a folder of this one alone: nothing is offered.
        self._env = {**os.environ, "DISPLAY": name, "XDG_STATE_HOME": str(folder / "state")}
        self._env.pop("WAYLAND_DISPLAY", None)
        self._log = folder / "events.txt"
        command = [sys.executable, "-m", "deformrf.viewer", str(model), "--log-events"]
        with self._log.open("w") as stream:
            self.process = subprocess.Popen(
                [*command, "--device", "cpu", *arguments],
                env=self._env,
                stdout=stream,
                stderr=subprocess.STDOUT,
                cwd=folder,
            )
        self.wait(lambda: self.last("ready"), 60, "the window is ready")
        self.wait(lambda: self.state()["refined"] == 1, 30, "the picture is refined")

    def tool(self, *arguments):
        done = subprocess.run(
            ["xdotool", *map(str, arguments)],
            env=self._env,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout

    def events(self, *names):
        lines = self._log.read_text().splitlines()
        entries = [json.loads(line) for line in lines if line.startswith("{") and line[-1] == "}"]
        return [entry for entry in entries if entry["event"] in names]

    def last(self, *names):
        found = self.events(*names)
        return found[-1] if found else None

    def state(self):
        return self.last("ready", "state")

    def next_state(self):
        """A state that is reported from now on."""
        count = len(self.events("state"))
        self.wait(lambda: len(self.events("state")) > count + 1, 20, "another state")
        return self.state()

    def wait(self, condition, seconds, what):
        end = time.monotonic() + seconds
        while not (value := condition()):
            assert self.process.poll() is None, self._log.read_text()[-2000:]
            assert time.monotonic() < end, f"waited {seconds} s until {what}"
            time.sleep(0.1)
        return value

    def vertex(self):
        """A visible vertex well away from the others and from the panel."""
        entries = self.state()["vertices"]
        at = np.array([entry["at"] for entry in entries])
        apart = np.linalg.norm(at[:, None] - at[None], axis=-1)
        np.fill_diagonal(apart, np.inf)
        apart = apart.min(axis=1)
        apart[at[:, 0] < 380] = 0.0
        best = apart.argmax()
        return entries[best]["id"], at[best]

    def position_of(self, vertex):
        return next(
            (np.array(e["at"]) for e in self.state()["vertices"] if e["id"] == vertex), None
        )

    def move(self, x, y):
        self.tool("mousemove", round(x), round(y))
        time.sleep(0.15)

    def drag(self, start, way, steps=8, button=1, release=True):
        """Press, move in steps, release."""
        self.move(*start)
        self.tool("mousedown", button)
        time.sleep(0.2)
        for k in range(1, steps + 1):
            self.move(*(np.asarray(start) + np.asarray(way) * k / steps))
        time.sleep(0.3)
        if release:
            self.tool("mouseup", button)
            time.sleep(0.2)

    def pixels(self):
        """The screen as it is now.  [H, W, 3] uint8"""
        return xwd_pixels(self._screen.read_bytes())

    def end(self):
        self.tool("mouseup", 1)  # should a test have failed in the middle of a drag
        if self.process.poll() is None:
            self.process.terminate()
            self.process.wait()


def xwd_pixels(raw):
    """An X window dump of 32 bits per pixel, as Xvfb keeps it."""
    header = struct.unpack(">25I", raw[:100])
    header_size, width, height, row_bytes, colors = (header[i] for i in (0, 4, 5, 12, 19))
    start = header_size + 12 * colors
    rows = np.frombuffer(raw, np.uint8, row_bytes * height, start).reshape(height, row_bytes)
    return rows[:, : 4 * width].reshape(height, width, 4)[:, :, 2::-1]


@pytest.fixture
def session(display, ball_file, tmp_path):
    made = Session(display, ball_file, tmp_path, "--size", "1000x700")
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
    assert not changed[:, 1100:].any()  # background, far from the object
    assert not changed[660:, 400:].any()

    session.tool("mouseup", 1)
    time.sleep(5.0)
    after = session.next_state()
    assert session.last("release")["vertex"] == vertex
    assert after["max_displacement"] < 0.01
    assert after["max_pin_displacement"] < 1e-6


def test_dragging_beside_the_object_orbits(session):
    before = session.state()
    session.drag((950, 650), (-60, 20))
    after = session.next_state()
    assert after["yaw"] != before["yaw"]
    assert session.events("grab") == []
    assert after["max_displacement"] < 1e-6
    assert session.last("orbit")["yaw"] == pytest.approx(after["yaw"])


def test_the_panel_keeps_its_clicks_wheel_and_drags(session):
    before = session.state()
    session.move(100, 400)
    for button in (4, 5, 4, 4):  # the wheel
        session.tool("click", button)
    session.drag((100, 250), (500, 100))  # the slider of the stiffness
    after = session.next_state()
    assert after["young_modulus"] > 10 * before["young_modulus"]
    for name in ("yaw", "pitch", "distance"):
        assert after[name] == before[name]
    assert session.events("grab", "orbit", "zoom") == []


def test_the_wheel_over_the_view_zooms(session):
    before = session.state()["distance"]
    session.move(700, 350)
    session.tool("click", 4)
    assert session.next_state()["distance"] < before


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


def test_the_window_closes_as_the_window_manager_asks(session, display):
    window = session.tool("search", "--name", "deformrf: ball").split()[-1]
    ask_to_close(display[0], int(window))
    assert session.process.wait(20) == 0


def ask_to_close(display_name, window):
    """What a window manager sends when the window's cross is clicked: WM_DELETE_WINDOW."""
    from pyglet.libs.x11 import xlib

    connection = xlib.XOpenDisplay(display_name.encode())
    event = xlib.XEvent()
    event.xclient.type = xlib.ClientMessage
    event.xclient.window = window
    event.xclient.message_type = xlib.XInternAtom(connection, b"WM_PROTOCOLS", False)
    event.xclient.format = 32
    event.xclient.data.l[0] = xlib.XInternAtom(connection, b"WM_DELETE_WINDOW", False)
    xlib.XSendEvent(connection, window, False, 0, event)
    xlib.XCloseDisplay(connection)
