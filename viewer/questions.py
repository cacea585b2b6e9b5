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


def question(app) -> str:
    """Which question the App asks: "leaving", "recovery", "dialog", "film", or an empty string."""
    if app.leaving is not None:
        return "leaving"
    if app.left_behind is not None:
        return "recovery"
    if app.dialog is not None:
        return "dialog"
    return "film" if app.takes.asking else ""


def dismiss(app) -> bool:
    """Take the question away, which decides nothing, as Esc does; whether there was one."""
    asked = question(app)
    if asked == "leaving":
        app.leaving = None
    elif asked == "recovery":
        app.left_behind = None  # it is asked at another start
    elif asked == "dialog":
        app.dialog = None
    elif asked == "film":
        app.takes.asking = False
    return bool(asked)


# -- the end -----------------------------------------------------------------------------------


def quit_or_ask(app) -> None:
    """The user wants to quit: do so if nothing would be lost, else ask."""
    if app.leaving is None:
        _go_on(app, set())


def follow(app) -> None:
    """Called in every frame: what the user is asked about may have ended."""
    leaving = app.leaving
    if leaving is None or leaving.about in _losses(app):
        return
    if leaving.waits and app.takes.failed:
        app.leaving = None  # what went wrong is said in the window
    else:
        _go_on(app, leaving.settled)


def settle(app) -> None:
    """What the user is asked about may be lost, or stopped where it is."""
    leaving = app.leaving
    if leaving.about == WORK and app.autosave is not None:
        app.autosave.end()
        app.autosave = None
    _go_on(app, leaving.settled | {leaving.about})


def save(app) -> None:
    """Save the work, into the project that is open; if that fails the question says why."""
    app.leaving.problem = app.save_session() if app.project is None else app.save_project()
    if not app.leaving.problem:
        _go_on(app, app.leaving.settled | {WORK})


def _losses(app):
    """What would be lost at the end."""
    if app.live is not None and not app.live.ended:
        return []  # training goes on without its window, and its objects can't be kept
    losses = {
        FILM: app.takes.job is not None,
        TRAINING: app.train_job is not None,
        WORK: app.scene is not None and app.scene.journal.unsaved,
    }
    return [name for name, is_so in losses.items() if is_so]


def _go_on(app, settled):
    """Ask about what isn't settled yet, or quit."""
    left = [name for name in _losses(app) if name not in settled]
    if left:
        app.leaving = Leaving(left[0], settled)
    else:
        app.leaving, app.window.has_exit = None, True
