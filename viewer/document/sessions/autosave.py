"""The session as it goes, kept in the user's folder: after a crash it can be played again.

The file is written some seconds after the first edit, grows by what is done later, and is
removed when the user has saved the session or discards it.  One that stays belongs to a run that
ended in another way.
"""

import os
import time
from pathlib import Path

from platformdirs import user_state_path

from .session import OpenObject, SessionError, append_events, mesh_hash, read_header, save_session

SECONDS = 5.0  # between two looks for edits
SHARE = 0.02  # of the time that writing may take
RETRY = 60.0  # s after a failure, until it is tried again
ABANDONED = 60.0  # s without a sign of life


def autosave_folder() -> Path:
    """Where the sessions of this user are kept."""
    return user_state_path("deformrf") / "sessions"


class Autosave:
    """Keeps the session of one object in a file."""

    def __init__(self, opened: OpenObject, start: dict, kept_in: Path, clock=time.monotonic):
        """Take an object that had this `start` (session.start_of), and a folder."""
        self.path = kept_in / f"{opened.name}-{os.getpid()}-{time.time_ns()}.jsonl"
        self.failed = False  # as on a full disk: the file is not whole
        self.kept = False  # for another start, though the viewer ends in order
        self._told: list[str] = []  # sentences about what the file can't have
        self._opened, self._start, self._clock = opened, start, clock
        self._saved = len(opened.journal.events)  # so many need no saving
        self._written = 0  # events that the file has
        self._next = clock() + SECONDS

    def update(self) -> str:
        """Called many times a second: write the file if it is time and something was done.

        Returns:
            What went wrong, said again every minute, or what the file lacks; else an empty string.
        """
        now = self._clock()
        if now < self._next:
            return ""
        good, told = self._tried(self.save if self._has_news() else self._touch)
        self._next = now + (SECONDS + (self._clock() - now) / SHARE if good else RETRY)
        return "; ".join(told)

    def save(self) -> None:
        """Write the file now.

        Raises:
            OSError: It can't be written.
        """
        count, tell = len(self._opened.journal.events), self._told.append
        grows = 0 < self._written <= count and not self.failed and self.path.exists()
        self.failed = True  # until it is whole: an interrupt may come
        if grows:
            append_events(self._opened, self.path, self._written, tell)
        else:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            save_session(self._opened, self._start, self.path, tell)
        self._saved = self._written = count
        self.failed = False

    def write(self) -> list[str]:
        """Write the file now; returns a sentence if that fails, or if the file lacks something."""
        return self._tried(self.save)[1]

    def _touch(self):
        if self.path.exists():
            os.utime(self.path)

    def _tried(self, work):
        """Whether the file could be written, and sentences about what it lacks, or why not."""
        try:
            work()
        except (OSError, ValueError) as error:
            self.failed = True
            return False, [f"what you do can't be kept in {self.path.parent}: {error}"]
        told, self._told = self._told, []
        return True, told

    def keep(self) -> list[str]:
        """Before another session takes the place of this one: keep it, if it has unsaved work.

        Returns:
            Sentences for the user.
        """
        self.kept = self._opened.journal.unsaved
        if not self.kept:
            return []
        good, told = self._tried(self.save)
        if good:
            told.append("what you did before is kept, and offered at another start")
        return told

    def leave(self) -> list[str]:
        """The viewer ends, or shows another session: keep this one, or remove its file."""
        sentences = self.keep()
        if not self.kept:
            self.end()
        return sentences

    def _has_news(self):
        """Whether something was done since, but for views."""
        events = self._opened.journal.events
        saved = self._saved if self._saved <= len(events) else 0  # another session has begun
        return any(event.name != "view" for event in events[saved:])

    def end(self) -> None:
        """All that was done is in another file, or is not wanted: remove this one.

        What is done from now on is kept anew.
        """
        self._saved, self._written = len(self._opened.journal.events), 0
        try:
            self.path.unlink(missing_ok=True)
        except OSError:
            pass  # it will be offered once


def left_behind(kept_in: Path, mesh) -> Path | None:
    """The newest session of this mesh whose viewer did not end in order; None if there is none."""
    rest, found = mesh_hash(mesh), []
    for path in kept_in.glob("*.jsonl"):
        try:
            if read_header(path).get("rest") == rest and not _runs(path):
                found.append((path.stat().st_mtime, path))
        except (OSError, SessionError):
            pass  # what can't be read is not offered
    return max(found)[1] if found else None


def _runs(path) -> bool:
    """Whether the viewer that writes a file is running."""
    if time.time() - path.stat().st_mtime > ABANDONED:
        return False  # a viewer touches its file every few seconds
    if os.name != "posix":  # there, asking for a process could end it
        return True
    try:
        writer = int(path.stem.split("-")[-2])
        os.kill(writer, 0)
    except (ProcessLookupError, ValueError, IndexError, OverflowError):
        return False
    except PermissionError:
        return True
    return writer != os.getpid()  # ours is new: another run of before had the same number
