"""The program in a real X window, and a hand on its mouse and keyboard: xdotool."""

import json
import os
import shutil
import struct
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np

NEEDED = ("Xvfb", "xdotool")
# Times what is usual: on a machine that does other things too, each letter takes a slow frame.
PATIENCE = 4
WATCHED = Path(__file__).with_name("watched_viewer.py")


def missing_tools():
    return [tool for tool in NEEDED if not shutil.which(tool)]


@contextmanager
def screen(folder, size="1200x900"):
    """An X server of our own: its name, and the file with its pixels."""
    reading, writing = os.pipe()
    server = subprocess.Popen(
        [
            *("Xvfb", "-displayfd", str(writing), "-screen", "0", f"{size}x24"),
            *("-noreset", "-fbdir", str(folder)),
        ],
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    with os.fdopen(reading) as stream:
        name = ":" + stream.readline().strip()
    try:
        yield name, folder / "Xvfb_screen0"
    finally:
        server.terminate()
        server.wait()


class LiveViewer:
    """deformrf view in a window, and a hand on mouse and keyboard."""

    before: tuple[str, ...] = ()  # what the program is started by
    rested = 0.0  # s that the hand has rested between its moves, whatever the program did

    def __init__(self, display, model, folder, *arguments):
        name, self._screen = display
        self.model = model
        # Kept sessions and preferences go into a folder of this one alone: nothing is offered.
        own = {"XDG_STATE_HOME": str(folder / "state"), "XDG_CONFIG_HOME": str(folder / "config")}
        self._env = {**os.environ, "DISPLAY": name, **own}
        for name in ("WAYLAND_DISPLAY", "OMP_NUM_THREADS"):  # as `make test` sets it
            self._env.pop(name, None)
        self._log = folder / "events.txt"
        command = [*self.before, sys.executable, str(WATCHED), str(model), "--log-events"]
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
        """What the condition comes to, when it does: usually in so many seconds."""
        seconds *= PATIENCE
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
        width = self.state()["size"][0]
        apart[(at[:, 0] < 80) | (at[:, 0] > width - 330)] = 0.0
        best = apart.argmax()
        return entries[best]["id"], at[best]

    def position_of(self, vertex):
        return next(
            (np.array(e["at"]) for e in self.state()["vertices"] if e["id"] == vertex), None
        )

    def rest(self, seconds):
        self.rested += seconds
        time.sleep(seconds)

    def move(self, x, y):
        self.tool("mousemove", round(x), round(y))
        self.rest(0.15)

    def click(self, x, y):
        self.move(x, y)
        self.tool("click", 1)
        self.rest(0.2)

    def place(self, label):
        """Where a button, a field or an item of a menu is."""
        self.wait(lambda: label in self.state()["widgets"], 20, f"{label!r} is shown")
        return self.state()["widgets"][label]

    def press(self, label):
        """Click on it."""
        self.click(*self.place(label))

    def find(self, words):
        """Call the action that the search finds first for some words."""
        self.tool("key", "ctrl+f")
        self.wait(lambda: self.state()["question"] == "dialog", 20, "the search is open")
        self.tool("type", words)
        self.rest(0.5)
        self.tool("key", "Return")
        self.wait(lambda: self.next_state()["question"] != "dialog", 20, f"{words!r} is done")

    def ask_to_close(self):
        """What a window manager sends when the window's cross is clicked: WM_DELETE_WINDOW."""
        from pyglet.libs.x11 import xlib

        window = int(self.tool("search", "--name", "deformrf: ").split()[-1])
        connection = xlib.XOpenDisplay(self._env["DISPLAY"].encode())
        event = xlib.XEvent()
        event.xclient.type = xlib.ClientMessage
        event.xclient.window = window
        event.xclient.message_type = xlib.XInternAtom(connection, b"WM_PROTOCOLS", False)
        event.xclient.format = 32
        event.xclient.data.l[0] = xlib.XInternAtom(connection, b"WM_DELETE_WINDOW", False)
        xlib.XSendEvent(connection, window, False, 0, event)
        xlib.XCloseDisplay(connection)

    def drag(self, start, way, steps=8, button=1, release=True, press=True):
        """Press, move in steps, release."""
        if press:
            self.move(*start)
            self.tool("mousedown", button)
            self.rest(0.2)
        for k in range(1, steps + 1):
            self.move(*(np.asarray(start) + np.asarray(way) * k / steps))
        self.rest(0.3)
        if release:
            self.tool("mouseup", button)
            self.rest(0.2)

    def pixels(self):
        """The screen as it is now.  [H, W, 3] uint8"""
        return xwd_pixels(self._screen.read_bytes())

    def end(self):
        self.tool("mouseup", 1)  # should a test have failed in the middle of a drag
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(30.0)
            finally:
                self.process.kill()  # or a process that hangs would outlive the tests


def xwd_pixels(raw):
    """An X window dump of 32 bits per pixel, as Xvfb keeps it."""
    header = struct.unpack(">25I", raw[:100])
    header_size, width, height, row_bytes, colors = (header[i] for i in (0, 4, 5, 12, 19))
    start = header_size + 12 * colors
    rows = np.frombuffer(raw, np.uint8, row_bytes * height, start).reshape(height, row_bytes)
    return rows[:, : 4 * width].reshape(height, width, 4)[:, :, 2::-1]
