"""The Record button: it marks a stretch of the session, of which a film can be made afterwards.

While it is on, nothing is read from the screen: a take is two ticks.  A film of it is rendered
in full, whatever the window showed (film_job.py).
"""

import os
from dataclasses import dataclass
from pathlib import Path

from ..document import TICKS_PER_SECOND, SessionError, save_session
from .film_job import FilmChoices, FilmJob
from .recorder import stamped


@dataclass(frozen=True)
class Take:
    """A stretch of a session."""

    first: int  # tick
    last: int

    @property
    def seconds(self) -> float:
        """Of the object's time."""
        return (self.last - self.first) / TICKS_PER_SECOND


class Takes:
    """Marks stretches of the App's session, and makes films of them."""

    def __init__(self, app):
        self.choices = FilmChoices()
        self.take: Take | None = None  # the last one
        self.job: FilmJob | None = None  # the film that is being rendered
        self.asking = False  # for the choices, in a window
        self.problem = ""  # why there is no film of these choices
        self.failed = False  # the last film
        self._app = app
        self._began: tuple | None = None  # the journal and its tick

    @property
    def recording(self) -> bool:
        """Whether a take has begun, in the session that goes on."""
        journal = None if self._app.scene is None else self._app.scene.journal
        began = self._began
        return began is not None and began[0] is journal and began[1] <= journal.tick

    @property
    def seconds(self) -> float:
        """The length so far."""
        return (self._app.scene.journal.tick - self._began[1]) / TICKS_PER_SECOND

    def start_or_stop(self) -> None:
        """Begin a take; or end it, and ask what film to make of it."""
        journal = self._app.scene.journal
        if not self.recording:
            self._app.scene.note_view()
            self._began = journal, journal.tick
            return
        self.take = Take(self._began[1], journal.tick)
        self._began = None
        self._ask()

    def ask(self) -> None:
        """Ask what film to make: of the last take, or else of all that was done."""
        journal = self._app.scene.journal
        if self.take is None or self.take.last > journal.tick:
            self.take = Take(0, journal.tick)
        self._ask()

    def forget(self) -> None:
        """Another scene or session is shown: what was taken of the one before is no more."""
        self.take = self._began = None
        self.asking = False

    def _ask(self):
        self.choices.name = stamped("film", "").name
        self.asking, self.problem = True, ""

    def start_film(self) -> None:
        """Make the film; the session is kept beside it, for another one."""
        self.problem = self._start()
        if self.problem:
            self._app.recorder.say(self.problem)

    def _start(self) -> str:
        """Begin the film; returns a sentence if that can't be."""
        app, choices, take = self._app, self.choices, self.take
        path = choices.path
        if self.job is not None:
            return "one film is being rendered: wait for it, or cancel it"
        if os.path.lexists(path):  # which takes any name
            return f"{path} is there already: choose another name"
        session = choices.session
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            save_session(app.scene, app.session_start, session, app.recorder.say)
        except SessionError as error:  # it is too long
            return str(error)
        except (OSError, ValueError) as error:
            return f"can't write {session}: {getattr(error, 'strerror', None) or error}"
        app.saved()
        device = "cuda" if app.scene.solver.device.is_cuda else "cpu"
        arguments = [*choices.arguments(app.size), "--device", device]
        arguments += ["--from", str(take.first), "--to", str(take.last)]
        self.job = FilmJob(app.scene.field, app.scene.name, session, arguments)
        app.log("film", path=path)
        self.asking = False
        return ""

    def update(self) -> None:
        """Called in every frame: say so when a film is ready."""
        job = self.job
        if job is None or not job.ended:
            return
        self.job, self.failed = None, job.written is None
        if job.written is not None:
            self._app.recorder.finished(Path(job.written))
        else:
            self._app.recorder.say(job.problem or "no film was made: it was cancelled at once")

    def close(self) -> None:
        """The viewer ends: a film that is being rendered ends where it is."""
        if self.job is not None:
            self.job.close()
            self.update()
