"""The session as it goes, kept in the user's folder: after a crash it can be played again.

The file is written some seconds after an edit and removed when the viewer ends in order.  One
that stays belongs to a run that did not.
"""

import json
import os
import time
from pathlib import Path

from platformdirs import user_state_path

from .session import mesh_hash, save_session

SECONDS = 5.0  # between two looks for edits
SHARE = 0.02  # of the time that writing may take
ABANDONED = 30.0  # s without a sign of life, where processes can't be asked


def folder() -> Path:
    """Where the sessions of this user are kept."""
    return user_state_path("deformrf") / "sessions"


class Autosave:
    """Keeps the session of one scene in a file."""

    def __init__(self, scene, start: dict, kept_in: Path, clock=time.monotonic):
        """Take a scene that had this `start` (session.start_of), and a folder."""
        self.path = kept_in / f"{scene.name}-{os.getpid()}-{time.time_ns()}.jsonl"
        self.failed = False  # a full disk: it is not tried again
        self._scene, self._start, self._clock = scene, start, clock
        self._count = len(scene.journal.events)  # events that need no saving
        self._next = clock() + SECONDS

    def update(self) -> None:
        """Called in every frame: write the file if it is time and something was done."""
        now = self._clock()
        if now < self._next or self.failed:
            return
        self._next = now + SECONDS
        count = sum(event.name != "view" for event in self._scene.journal.events)
        try:
            if count > self._count:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                save_session(self._scene, self._start, self.path)
                self._count = count
            elif self.path.exists():
                os.utime(self.path)
        except OSError:
            self.failed = True
        self._next += (self._clock() - now) / SHARE

    def end(self) -> None:
        """The viewer ends in order: the file is not needed."""
        try:
            self.path.unlink(missing_ok=True)
        except OSError:
            pass  # it will be offered once


def left_behind(kept_in: Path, mesh) -> Path | None:
    """The newest session of this mesh whose viewer did not end in order; None if there is none."""
    rest, found = mesh_hash(mesh), []
    try:
        files = sorted(kept_in.glob("*.jsonl"), key=lambda path: path.stat().st_mtime)
        for path in files:
            with open(path, encoding="utf-8") as file:
                header = json.loads(file.readline(2**24))
            if isinstance(header, dict) and header.get("rest") == rest and not _runs(path):
                found.append(path)
    except (OSError, ValueError, RecursionError):
        pass  # what can't be read is not offered
    return found[-1] if found else None


def _runs(path) -> bool:
    """Whether the viewer that writes a file is running."""
    if os.name == "posix":
        try:
            os.kill(int(path.stem.split("-")[-2]), 0)
        except (ProcessLookupError, ValueError, IndexError, OverflowError):
            return False
        except PermissionError:
            pass  # somebody else's process has the number now; its file's age tells
        else:
            return True
    return time.time() - path.stat().st_mtime < ABANDONED
