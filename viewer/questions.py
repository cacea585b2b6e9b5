"""The questions in the middle of the window, one at a time; the one before the end is here.

A user who quits is asked about what would be lost: a film that is being rendered, training that
the viewer began, work that no file has.  Asking again answers nothing.  Signals can't ask: they
keep the session for another start (commands/view.py).
"""

from dataclasses import dataclass, field

FILM, TRAINING, WORK = "film", "training", "work"


@dataclass
class Leaving:
    """The user wants to quit, and is asked.

    Attributes:
        about: What would be lost: FILM, TRAINING or WORK.
        settled: What the user has decided to lose, or to stop.
        waits: Whether to quit when the film is done.
        problem: Why the work can't be saved.
    """

    about: str
    settled: set[str] = field(default_factory=set)
    waits: bool = False
    problem: str = ""


class Questions:
    """What one window asks.

    Attributes:
        leaving: What is asked before the end, or None.
        left_behind: The session whose viewer did not end in order, or None.
        dialog: The choice of a file, an offer, or a problem that is told of; or None.
    """

    def __init__(self, app):
        self.leaving: Leaving | None = None
        self.left_behind = self.dialog = None
        self._app = app

    @property
    def name(self) -> str:
        """Which one is asked: "leaving", "recovery", "dialog", "film", or an empty string."""
        if self.leaving is not None:
            return "leaving"
        if self.left_behind is not None:
            return "recovery"
        if self.dialog is not None:
            return "dialog"
        return "film" if self._app.takes.asking else ""

    def dismiss(self) -> bool:
        """Take the question away, which decides nothing, as Esc does; whether there was one."""
        asked = self.name
        if asked == "leaving":
            self.leaving = None
        elif asked == "recovery":
            self.left_behind = None  # it is asked at another start
        elif asked == "dialog":
            self.dialog = None
        elif asked == "film":
            self._app.takes.asking = False
        return bool(asked)

    # -- the end -------------------------------------------------------------------------

    def leave(self) -> None:
        """The user wants to quit: do so if nothing would be lost, else ask."""
        if self.leaving is None:
            self._go_on(set())

    def follow(self) -> None:
        """Called in every frame: what the user is asked about may have ended."""
        leaving = self.leaving
        if leaving is None or leaving.about in self._losses():
            return
        if leaving.waits and self._app.takes.failed:
            self.leaving = None  # what went wrong is said in the window
        else:
            self._go_on(leaving.settled)

    def settle(self) -> None:
        """What the user is asked about may be lost, or stopped where it is."""
        app, leaving = self._app, self.leaving
        if leaving.about == WORK and app.autosave is not None:
            app.autosave.end()
            app.autosave = None
        self._go_on(leaving.settled | {leaving.about})

    def save(self) -> None:
        """Save the work as a project; if that fails the question stays, and says why."""
        self.leaving.problem = self._app.save_project()
        if not self.leaving.problem:
            self._go_on(self.leaving.settled | {WORK})

    def _losses(self):
        """What would be lost at the end."""
        app, job = self._app, self._app.train_job
        trains = job is not None and not job.ended
        if trains and job.stays:
            return []  # training goes on without its window, and its objects can't be kept
        losses = {
            FILM: app.takes.job is not None,
            TRAINING: trains,
            WORK: app.scene is not None and app.scene.journal.unsaved,
        }
        return [name for name, is_so in losses.items() if is_so]

    def _go_on(self, settled):
        """Ask about what isn't settled yet, or quit."""
        left = [name for name in self._losses() if name not in settled]
        if left:
            self.leaving = Leaving(left[0], settled)
        else:
            self.leaving, self._app.window.has_exit = None, True
