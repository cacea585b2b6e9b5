"""The Record button, which marks a section of the session, and films of it and of the rest.

While it is on, nothing is read from the screen: a take is two ticks.  A film of it is rendered
in full, whatever the window showed (film_job.py).
"""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from ..document import TICKS_PER_SECOND, Scene, SessionError, save_session
from ..preferences import Preferences
from .choices import KINDS, FilmChoices
from .estimate import Estimator
from .film_job import FilmJob
from .recorder import Recorder, stamped


class FilmedApp(Protocol):
    """What Takes needs of the App."""

    scene: Scene | None
    session_start: dict[str, Any]
    recorder: Recorder
    log: Callable
    size: tuple[int, int]
    preferences: Preferences

    def saved(self) -> None: ...


class Takes:
    """Marks sections of a session, and makes films.

    Attributes:
        choices: Of the dialog.
        take: The first and the last tick of the last one.
        job: The film that is being rendered.
        asking: Whether the dialog is open.
        problem: Why there is no film of these choices.
        failed: Whether the last film failed.
        estimator: Finds out how long the film takes, while the dialog is open.
        shows_frame: Whether the view shows the film's frame, also without the dialog.
    """

    def __init__(self, filmed: FilmedApp):
        self.choices = FilmChoices(folder=filmed.preferences.film_folder)
        self.take: tuple[int, int] | None = None
        self.job: FilmJob | None = None
        self.asking = self.failed = self.shows_frame = False
        self.problem = ""
        self.estimator = Estimator(self._begin_estimate)
        self._filmed = filmed
        self._began: tuple | None = None  # the journal and its tick
        self._folder: tempfile.TemporaryDirectory | None = None  # for estimates

    @property
    def recording(self) -> bool:
        """Whether a take has begun, in the session that goes on."""
        journal = None if self._filmed.scene is None else self._filmed.scene.journal
        began = self._began
        return began is not None and began[0] is journal and began[1] <= journal.tick

    @property
    def seconds(self) -> float:
        """The length so far."""
        return (self._filmed.scene.journal.tick - self._began[1]) / TICKS_PER_SECOND

    @property
    def size(self) -> tuple[int, int]:
        """Of the window [pixels]."""
        return self._filmed.size

    @property
    def aspect(self) -> float:
        """Width over height of the film that is chosen."""
        width, height = self.choices.pixels(self.size)
        return width / max(height, 1)

    def start_or_stop(self) -> None:
        """Begin a take; or end it, and ask what film to make of it."""
        journal = self._filmed.scene.journal
        if not self.recording:
            self._filmed.scene.note_view()
            self._began = journal, journal.tick
            return
        self.take, self._began = (self._began[1], journal.tick), None
        if self.why_not("take"):
            self._filmed.recorder.say(f"no film: {self.why_not('take')}")
        else:
            self.ask("take")

    def ask(self, what: str = "") -> None:
        """Ask what film to make; by default of the first of KINDS that there is."""
        self.choices.what = what or next(kind for kind in KINDS if not self.why_not(kind))
        self.choices.name = stamped("film", "").name
        self.asking, self.problem = True, ""

    def forget(self) -> None:
        """Another scene or session is shown: what was taken of the one before is no more."""
        self.take = self._began = None
        self.asking = False

    def film_seconds(self, what: str) -> float:
        """How long a film of one of KINDS would be; 0: there is none."""
        if what == "turntable":
            return self.choices.turn_seconds
        timeline, now = self._filmed.scene.timeline, self._filmed.scene.journal.tick
        first, last = self.take or (0, 0)
        ticks = {"take": last - first if last <= now else 0, "timeline": timeline.end, "all": now}
        return ticks[what] / TICKS_PER_SECOND

    def why_not(self, what: str) -> str:
        """Why there is no film of one of KINDS; empty if there is."""
        if self.film_seconds(what):
            return ""
        if what == "take":
            return "nothing was recorded" if self.take is None else "the take has no tick"
        return "it has no keys" if what == "timeline" else "nothing was done yet"

    def start_film(self) -> None:
        """Make the film; the session is kept beside it, for another one."""
        self.problem = self._start()
        if self.problem:
            self._filmed.recorder.say(self.problem)

    def _start(self) -> str:
        """Begin the film; returns a sentence if that can't be."""
        choices, why_not = self.choices, self.why_not(self.choices.what)
        if not Path(choices.name).name:  # as of "/"
            return "a film needs a name"
        path, session = choices.path, choices.session
        if self.job is not None:
            return "one film is being rendered: wait for it, or cancel it"
        if why_not:
            return f"there is no film of {KINDS[choices.what]}: {why_not}"
        if os.path.lexists(path):  # which takes any name
            return f"{path} is there already: choose another name"
        problem = choices.size_problem(self.size) or self._save(session)
        if problem:
            return problem
        self._filmed.saved()
        arguments = choices.arguments(self.size, session, self.take)
        self.job = self._begin([*arguments, "-o", str(path)])
        self._filmed.log("film", path=path)
        self._filmed.preferences.film_folder = choices.folder
        self.asking = False
        return ""

    def _save(self, session: Path) -> str:
        """Write the session; returns a sentence if that can't be."""
        filmed = self._filmed
        filmed.scene.note_view()
        try:
            session.parent.mkdir(parents=True, exist_ok=True)
            save_session(filmed.scene, filmed.session_start, session, filmed.recorder.say)
        except SessionError as error:  # it is too long
            return str(error)
        except (OSError, ValueError) as error:
            return f"can't write {session}: {getattr(error, 'strerror', None) or error}"
        return ""

    def update(self) -> None:
        """Called in every frame: say so when a film is ready."""
        self.estimator.follow(self._to_estimate())
        job = self.job
        if job is None or not job.ended:
            return
        self.job, self.failed = None, job.written is None
        if job.written is not None:
            self._filmed.recorder.finished(job.written)
        else:
            self._filmed.recorder.say(job.problem or "no film was made: it was cancelled at once")

    def _to_estimate(self):
        """The arguments of the film that is asked for; None: there is no such film."""
        choices = self.choices
        if not self.asking or self.job is not None:
            return None
        if self.why_not(choices.what) or choices.size_problem(self.size):
            return None
        at = self._scratch()
        arguments = choices.arguments(self.size, at / "film.jsonl", self.take)
        return [*arguments, "-o", str(at / f"film{choices.ending}")]

    def _scratch(self) -> Path:
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="deformrf-")
        return Path(self._folder.name)

    def _begin_estimate(self, arguments):
        self._save(self._scratch() / "film.jsonl")
        return self._begin(arguments)

    def close(self) -> None:
        """The viewer ends: a film that is being rendered ends where it is."""
        self.asking = False
        if self.estimator.job is not None:
            self.estimator.job.close()
        if self._folder is not None:
            self._folder.cleanup()
        if self.job is not None:
            self.job.close()
            self.update()

    def _begin(self, arguments: list[str]) -> FilmJob:
        scene = self._filmed.scene
        device = "cuda" if scene.solver.device.is_cuda else "cpu"
        return FilmJob(scene.field, scene.name, [*arguments, "--device", device])
