"""A hand that finds what is drawn, scrolls to it, and looks for trouble after each step."""

import json
import math
import os
import shutil
import time

from PIL import Image
from watched_viewer import CLOSELY
from xwindow import LiveViewer

PATIENCE = 30.0  # s until a window answers
FRAMES = 4  # until a click has done what it does
TEXTS = {  # what is typed into fields
    "nan": "nan",
    "-inf": "-inf",
    "1e400": "1e400",
    "empty": "",
    "text": "text",
    "long": "long" * 75,
    "non-Latin": "жñ日",
}
WITHOUT_RIGHTS = "-dac_override,-dac_read_search"  # root, too, is refused what has no permission
MAIN = "##MainMenuBar"


class Gone(Exception):
    """The process has ended."""


class Tally:
    """How often what was tried, and what went wrong."""

    def __init__(self, pictures=None):
        self.counts, self.wrong, self.pictures = {}, [], pictures

    def tried(self, part: str, what: str) -> None:
        self.counts[part, what] = self.counts.get((part, what), 0) + 1

    def note(self, part: str, step: str, sentence: str) -> None:
        self.wrong.append((part, step, sentence))
        print(f"  {part}, {step}: {sentence}", flush=True)


class Hand(LiveViewer):
    """The viewer in a window of its own; every step is looked at."""

    def __init__(self, display, model, folder, size, tally, *arguments):
        self.before = ()
        if os.geteuid() == 0 and shutil.which("setpriv"):
            self.before = "setpriv", f"--bounding-set={WITHOUT_RIGHTS}"
        self.tally, self.size, self.folder = tally, size, folder
        self._read, self._rest, self._states, self._kept, self._waits = 0, b"", 0, [], 0
        self._state = None
        self._noted, self.stays = set(), ""
        self._log_size = 0
        os.environ[CLOSELY] = "1"
        super().__init__(display, model, folder, "--size", f"{size[0]}x{size[1]}", *arguments)

    # -- what the program tells ----------------------------------------------------------

    def _follow(self):
        """Read what it has said since."""
        with self._log.open("rb") as stream:
            stream.seek(self._read)
            data = stream.read()
        self._read += len(data)
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            if not line.startswith(b"{"):
                if b"Traceback" in line or b"Exception ignored" in line:
                    self._kept.append({"event": "said", "line": line.decode("utf-8", "replace")})
                continue
            entry = json.loads(line)
            if entry["event"] in ("ready", "state"):
                self._state, self._states = entry, self._states + 1
            if entry["event"] != "state":
                self._kept.append(entry)

    def events(self, *names):
        self._follow()
        return [entry for entry in self._kept if entry["event"] in names]

    def state(self):
        self._follow()
        return self._state

    def fresh(self):
        """The state after what was done last: ImGui divides a click among frames."""
        self._follow()
        end = time.monotonic() + PATIENCE
        while self._waits and (self._states < self._waits or self._state["queued"]):
            if self.process.poll() is not None:
                raise Gone(self._last_words())
            if time.monotonic() > end:
                raise TimeoutError(f"no answer within {PATIENCE:.0f} s")
            time.sleep(0.02)
            self._follow()
        self._waits = 0
        return self._state

    def tool(self, *arguments):
        self._follow()
        self._waits = self._states + FRAMES
        return super().tool(*arguments)

    def move(self, x, y):
        self.tool("mousemove", round(x), round(y))
        self.rest(0.03)

    def click(self, x, y):
        self.tool("mousemove", round(x), round(y), "click", 1)

    def _last_words(self):
        said = [
            one for one in self._log.read_text("utf-8", "replace").splitlines() if one[:1] != "{"
        ]
        return f"exit code {self.process.returncode}, {' / '.join(said)[-1500:]}"

    def next_state(self):
        self._waits = self._states + 2
        return self.fresh()

    def wait(self, condition, seconds, what):
        end = time.monotonic() + seconds
        while not (value := condition()):
            if self.process.poll() is not None:
                raise Gone(self._last_words())
            if time.monotonic() > end:
                raise TimeoutError(f"waited {seconds} s until {what}")
            time.sleep(0.05)
        return value

    def note(self, part, step, sentence):
        """Something is wrong: tell of it, with a picture if there is a folder for them."""
        self.tally.note(part, step, sentence)
        if self.tally.pictures is not None:
            name = f"{self.size[0]}-{len(self.tally.wrong)}.png"
            Image.fromarray(self.pixels()).save(self.tally.pictures / name)

    # -- looking -------------------------------------------------------------------------

    def check(self, part: str, step: str) -> dict:
        """Look at everything after a step; returns the state."""
        state = self.fresh()
        found = [f"panel: {message}" for message in state["failed"]]
        found += [f"two items have the id of {label}" for label in state["twice"]]
        found += [f"{name} is {value}" for name, value in _not_finite(state["values"])]
        found += [entry["line"] for entry in self.events("said")]
        found += self._logged()
        if state["dialog"] == "Something went wrong":
            found.append("an error is told of")
        for sentence in found:
            if sentence not in self._noted:
                self._noted.add(sentence)
                self.note(part, step, sentence)
        return state

    def _logged(self):
        """New errors in the viewer's log."""
        (path,) = self.folder.glob("state/deformrf/log/viewer.log") or [None]
        text = path.read_text(encoding="utf-8", errors="replace")
        new, self._log_size = text[self._log_size :], len(text)
        lines = new.splitlines()
        places = [n for n, line in enumerate(lines) if " ERROR " in line or "Traceback" in line]
        return [" / ".join(lines[n : n + 30])[-900:] for n in places if " ERROR " in lines[n]]

    def item(self, key, kind=""):
        """An item that is drawn, by its id or label; None if there is none."""
        items = self.fresh()["items"]
        return next((i for i in items if key in (i["id"], i["label"]) and kind in i["kind"]), None)

    def reach(self, key, kind=""):
        """Scroll an item into sight; where it is [points of the window], or None."""
        for _ in range(40):
            one = self.item(key, kind)
            if one is None:
                return None
            (left, top, right, low), inside = one["rect"], one["inside"]
            x = 0.5 * (max(left, inside[0]) + min(right, inside[2]))
            y, scale = 0.5 * (top + low), self.state()["scale"]
            if inside[1] + 1.0 < y < inside[3] - 1.0:
                cut = min(right, inside[2]) - max(left, inside[0]) < 3.0
                width, height = self.size
                within = 0.0 <= scale * x < width and 0.0 <= scale * y < height
                return None if cut or not within else (scale * x, scale * y)
            if not one["scrolls"]:
                return None
            self.move(
                scale * 0.5 * (inside[0] + inside[2]), scale * (0.5 * (inside[1] + inside[3]))
            )
            self.tool("click", 5 if y > inside[1] + 1.0 else 4)
        return None

    def reach_and_click(self, key, kind="") -> bool:
        place = self.reach(key, kind)
        if place is not None:
            self.click(*place)
        return place is not None

    # -- doing ---------------------------------------------------------------------------

    def keys(self, *names):
        self.tool("key", *names)

    def type(self, text):
        """Type a text; it takes the place of what is selected."""
        if text == "":
            self.keys("BackSpace")
        elif text.isascii():
            self.tool("type", "--delay", 1, "--", text)
        else:
            self.tool("type", "--delay", 400, "--", text)

    def calm(self) -> dict:
        """Close lists, dialogs and the help; end flights and drags; show the panel.

        The question `stays`, if that is asked, does so, and only lists over it are closed.
        """
        for _ in range(8):
            state = self.fresh()
            if self.stays and state["question"] == self.stays and len(state["popups"]) < 2:
                return state
            settings = state["values"]["settings"]
            busy = state["popups"] or state["question"] or state["flying"] or settings["show_help"]
            if not busy and state["mode"] in ("", "orbit"):
                break
            self.keys("Escape")
        else:
            raise TimeoutError(f"Esc doesn't end {state['question']!r}, {state['popups']}")
        if not settings["show_panel"]:
            self.keys("Tab")
        return self.fresh()

    def bend(self):
        """Work that no file has."""
        self.calm()
        width, height = self.size
        for x, y in ((0.42, 0.5), (0.36, 0.55), (0.45, 0.42)):
            place = width * x, height * y
            self.drag(place, (25, -15), steps=4)
            if self.fresh()["unsaved"]:
                return
        self.keys("k")  # a key is work, too
        self.fresh()


def _not_finite(values, name=""):
    """Numbers that are not finite, and their names."""
    if isinstance(values, dict):
        for key, value in values.items():
            yield from _not_finite(value, f"{name}.{key}".lstrip("."))
    elif isinstance(values, list):
        for value in values:
            yield from _not_finite(value, name)
    elif isinstance(values, float) and not math.isfinite(values):
        yield name, values
