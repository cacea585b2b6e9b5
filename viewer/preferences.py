"""What the viewer remembers from one start to the next: a JSON file in the user's folder.

Nothing in the file is trusted: a value that can't be is left out, and the file is then moved
aside, with a message.  Options of the command line come before it.
"""

import json
import os
import time
from dataclasses import asdict, dataclass, field, fields, make_dataclass
from pathlib import Path

import numpy as np
from platformdirs import user_config_path

from ..core.base import schema
from ..core.base.paths import whole_file
from ..core.base.reading import open_file
from ..core.base.streams import shown
from .settings import TARGETS, Settings, kept_in

KEY, VERSION = "deformrf preferences", 1
LARGEST_FILE = 2**20  # bytes
MOST_RECENT = 10  # files that were opened
SMALLEST_WINDOW, LARGEST_WINDOW = (320, 240), 8192
KEPT = kept_in("preferences")  # of the Settings: whether a value of the file is one
_kept = [one for one in fields(Settings) if one.name in KEPT]
Kept = make_dataclass("Kept", [(one.name, one.type, one.default) for one in _kept])


@dataclass
class Preferences(Kept):
    """What is remembered: the KEPT settings, and more; `path` is the file, None keeps nothing."""

    window_size: tuple[int, int] = (1200, 800)  # points
    interop: str = "auto"  # how CUDA frames reach OpenGL, as --interop
    target_fps: float | None = None  # None: what suits the device
    film_folder: str = ""  # as it was typed; empty: the current one
    recent: list[str] = field(default_factory=list)  # absolute paths, the last one first
    path: Path | None = None

    def opened(self, path: Path) -> None:
        """A file was opened: it is the first of the recent ones."""
        name = os.path.abspath(path)
        self.recent = [name, *(other for other in self.recent if other != name)][:MOST_RECENT]

    def save(self) -> str:
        """Write the file; returns what went wrong in a sentence, or an empty string."""
        if self.path is None:
            return ""
        values = {KEY: VERSION} | asdict(self)
        del values["path"]
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(self.path) as partial:
                partial.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            return f"can't keep the preferences in {self.path}: {error.strerror or error}"
        return ""


def file() -> Path:
    """Where the preferences of this user are."""
    return user_config_path("deformrf") / "preferences.json"


def is_path(text: str) -> bool:
    """Whether a system may take it for a path."""
    return "\0" not in text


GOOD = KEPT | {
    "window_size": schema.row(
        *(schema.integer(least, LARGEST_WINDOW) for least in SMALLEST_WINDOW)
    ),
    "interop": schema.one_of(("auto", "buffer", "copy")),
    "target_fps": schema.optional(schema.number(*TARGETS)),
    "film_folder": schema.both(schema.text(), is_path),
    "recent": schema.listing(schema.both(schema.text(least=1), is_path), MOST_RECENT),
}


def load(path: Path) -> tuple[Preferences, str]:
    """Read the preferences.

    Returns:
        What is good of them, else the defaults; and a sentence if the file was damaged, which
        has another name then.
    """
    try:
        with open_file(path) as opened:
            content = opened.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        return Preferences(path=path), ""
    except OSError as error:
        return Preferences(), f"can't read the preferences in {path}: {error.strerror or error}"
    values, problem = _checked(content)
    values |= {n: tuple(values[n]) for n in ("window_size", "background") if n in values}
    loaded = Preferences(**values, path=path)
    if problem:
        aside = path.with_name(f"{path.stem}-damaged-{time.time_ns()}{path.suffix}")
        try:
            path.rename(aside)
            problem = f"the preferences {problem}: the file is now {aside}"
        except OSError:
            loaded.path = None  # it is left as it is
            problem = f"the preferences in {path} {problem}"
    return loaded, problem


def _checked(content):
    """The good values, and what is wrong with the others."""
    if len(content) > LARGEST_FILE:
        return {}, f"have more than {LARGEST_FILE >> 20} MiB"
    try:
        values = json.loads(content)
    except (ValueError, RecursionError):
        return {}, "are not JSON"
    if not isinstance(values, dict) or values.get(KEY) != VERSION:
        return {}, f"don't say that they are of version {VERSION}"
    good = {name: values[name] for name in GOOD if name in values and GOOD[name](values[name])}
    bad = [name for name in GOOD if name in values and name not in good]
    return good, f"can't have {bad[0]} = {shown(values[bad[0]])}" if bad else ""


def apply(preferences: Preferences, settings: Settings) -> None:
    """Set the settings that are remembered."""
    for name in KEPT:
        setattr(settings, name, getattr(preferences, name))
    settings.target_fps = preferences.target_fps or settings.target_fps


def take(preferences: Preferences, settings: Settings, usual_fps: float) -> None:
    """Remember the settings; the target frame rate only if it is not the device's usual one."""
    values = {name: getattr(settings, name) for name in KEPT}
    values["target_fps"] = None if settings.target_fps == usual_fps else settings.target_fps
    for name, value in values.items():
        if GOOD[name](value):
            setattr(preferences, name, value)


def take_window(preferences: Preferences, size: tuple[int, int]) -> None:
    """Remember the window's size, as far as one can begin with it."""
    low, high = np.array(SMALLEST_WINDOW), LARGEST_WINDOW
    preferences.window_size = tuple(np.clip(size, low, high).tolist())
