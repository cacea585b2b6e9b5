"""Play a session: make its edits again, at their ticks, on a scene at rest.

A file of two lines may last for a day.  Ticks in which nothing moves are skipped.  The others are
played in batches: between two of them the user is told how long it will take, and can stop.
"""

import logging
import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ....core.base.device import start_warp
from ....core.field import TetField
from ...camera import changed
from ..history.journal import EDITS
from ..scene.points import ControlPoints
from ..scene.scene import Scene
from .session import Session, SessionError, load_session, start_of
from .session_values import OPTIONS, ORBIT

BATCH_SECONDS = 0.05  # of playing, between two looks at the clock or for events
SURE_SECONDS = 2.0  # until the time that is left can be told
LONG = 600.0  # s that are left: whether to go on is asked
SILENT_SECONDS, LINE_SECONDS = 1.0, 30.0  # between two lines on a terminal, in a file

log = logging.getLogger(__name__)


class Player:
    """Plays a session on a scene at rest, tick by tick."""

    def __init__(self, scene: Scene, session: Session):
        self.scene, self.session = scene, session
        self._made = 0  # events
        with self._told():
            self._begin(start_of(scene))

    def _begin(self, own):
        scene, start = self.scene, own | self.session.header["start"]
        if start.pop("stiffness") != own.pop("stiffness"):
            raise SessionError("the session is of a copy of this model with other stiffnesses")
        if start.pop("rig") != own.pop("rig"):
            raise SessionError("the session is of a copy of this model with another rig")
        scene.settings.hand = start.pop("hand")  # else a `choose_hand` might be a step, or none
        del own["hand"]
        if start != own:
            scene.floor = start.pop("floor")
            scene.handles.points = ControlPoints.of_rows(start.pop("points"))
            scene.pins = np.isin(np.arange(len(scene.pins)), start.pop("pins"))
            scene.solver.set_pinned(scene.pins)
            scene.body.set_scale(start.pop("meters_per_unit"))
            scene.body.set_options(**{name: start.pop(name) for name in ("integrator", *OPTIONS)})
            scene.body.automatic_substeps = start.pop("automatic_substeps")
            scene.body.set_material(**_infinite(start))
            scene.solver.reset()  # it sleeps, as it did when the session began
            scene.journal.clear()

    def play_to(self, tick: int, seconds: float = math.inf) -> bool:
        """Let time pass until so many ticks have passed; edits of that tick are made, too.

        Args:
            seconds: After which playing stops where it is.

        Returns:
            Whether all of it was played.

        Raises:
            SessionError: An edit is impossible.
        """
        end = time.perf_counter() + seconds
        with self._told():
            while goes_on := self._step(tick):
                if time.perf_counter() > end:
                    break
            self.scene.look(0.0)
        return not goes_on

    @property
    def following(self) -> int | None:
        """The tick of the next edit; None after the last one."""
        events = self.session.events
        return events[self._made].tick if self._made < len(events) else None

    def adapting(self, tick: int):
        """Let ticks pass as in the viewer, with substeps that adapt; yields the tick after each."""
        while self.scene.journal.tick < tick:
            self.scene.body.adapt_substeps()
            self.scene.clock.tick()
            yield self.scene.journal.tick

    def _step(self, tick):
        """Make the next edit, or let a tick pass; whether there was something to do."""
        scene, journal, following = self.scene, self.scene.journal, self.following
        if following is not None and following <= journal.tick:
            self._made += 1
            self._make(self.session.events[self._made - 1])
        elif journal.tick >= tick:
            return False
        elif scene.clock.moving:
            scene.clock.tick()
        else:  # until the next edit, nothing happens
            journal.tick = tick if following is None else min(tick, following)
        return True

    def batches(self, tick: int):
        """Play as `play_to` does, in batches of BATCH_SECONDS; yields the tick after each."""
        while not self.play_to(tick, BATCH_SECONDS):
            yield self.scene.journal.tick

    @contextmanager
    def _told(self):
        """Turn errors of the block into a SessionError that names the last edit that was made.

        A ValueError says that this model can't have the edit.  Any other error is a fault of the
        program: its traceback goes into the viewer's log, and to stderr with --verbose.
        """
        try:
            yield
        except (SessionError, MemoryError):
            raise
        except Exception as error:
            reason = str(error)
            if not isinstance(error, ValueError):
                reason = f"{type(error).__name__}: {error}"
                log.info("an edit of a session failed", exc_info=True)
            where = "the session" if self.session.path is None else self.session.path
            if self._made:
                event = self.session.events[self._made - 1]
                where = f"{where}, line {self._made + 1}: {event.name} at tick {event.tick}"
            raise SessionError(f"{where} can't be played: {reason:.200}") from error

    def _make(self, event):
        scene = self.scene
        if event.name == "view":
            self._show(event.arguments)
            return
        made = EDITS[event.name]
        arguments = event.arguments
        if event.name == "set_material":
            arguments = _infinite(arguments)
        owner = getattr(scene, made.owner) if made.owner else scene
        getattr(owner, made.method)(**arguments)
        if scene.handles.grabbed is not None:
            scene.handles.grabbed.target = scene.handles.grabbed.reached
        if scene.ball is not None:
            scene.ball.target = scene.ball.reached

    def _show(self, view):
        scene = self.scene
        scene.orbit = changed(scene.orbit, {name: view[name] for name in ORBIT if name in view})
        for name in set(view) - set(ORBIT):
            value = tuple(view[name]) if name == "background" else view[name]
            setattr(scene.settings, name, value)
        scene.note_view()


class Patience:
    """Tells the user how long work will take, and asks whether to go on if that is LONG."""

    def __init__(self, what: str, total: int):
        """Take a name for the work, and the number of its ticks."""
        self.what, self.total = what, total
        self.agreed = False  # to what takes long
        self._since = self._told = time.perf_counter()

    def left(self, done: int) -> float | None:
        """Seconds until all ticks are done, as the first ones say; None before that is known."""
        passed = time.perf_counter() - self._since
        if passed < SURE_SECONDS or not done:
            return None
        return passed / done * (self.total - done)

    def asks(self, done: int) -> bool:
        """Whether to ask before going on."""
        return not self.agreed and (self.left(done) or 0.0) > LONG

    def heed(self, done: int) -> None:
        """In a command: say how far the work is, and ask on a terminal whether to go on.

        Raises:
            KeyboardInterrupt: The user doesn't want to.
        """
        on_terminal = sys.stderr.isatty()
        if self.asks(done):
            self.agreed = True
            self._ask(done, on_terminal and sys.stdin is not None and sys.stdin.isatty())
        now = time.perf_counter()
        if now - self._told > (SILENT_SECONDS if on_terminal else LINE_SECONDS):
            self._told = now
            end = "\r" if on_terminal else "\n"
            print(f"{self.what}: {self.line(done)}  ", end=end, file=sys.stderr, flush=True)

    def line(self, done: int) -> str:
        """How much is done, and how long the rest takes."""
        left = self.left(done)
        words = "" if left is None else f", {spoken(left)} left"
        return f"{done / max(self.total, 1):.0%}{words}"

    def _ask(self, done, can_answer):
        about = f"{self.what} takes about {spoken(self.left(done))} more"
        if not can_answer:
            print(f"{about}; Ctrl-C ends it", file=sys.stderr, flush=True)
            return
        print(f"{about}. Go on? [y/N] ", end="", file=sys.stderr, flush=True)
        since = time.perf_counter()
        if sys.stdin.readline().strip().lower() not in ("y", "yes"):
            raise KeyboardInterrupt
        self._since += time.perf_counter() - since


def spoken(seconds: float) -> str:
    """A length of time for people: 40 s, 12 min, 3 h."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.0f} h"


def play_patiently(player: Player, tick: int) -> None:
    """Play in a command until a tick: how far it is stands on stderr."""
    begin = player.scene.journal.tick
    patience = Patience("playing the session", tick - begin)
    for now in player.batches(tick):
        patience.heed(now - begin)


def poses(
    path: str | Path, field: TetField, every: int = 1, device: str = "cpu"
) -> Iterator[np.ndarray]:
    """Play a session of a model, and yield its vertices at tick 0, `every`, 2 `every` ...

    What the user deleted is not in it: the vertices are those of the whole model.

    Args:
        field: The model as it was when the session began.
        every: Ticks of 1/60 s from one pose to the next.
        device: Warp's name; a session played on another device than it was recorded on ends
            in another pose, though in a similar one.

    Yields:
        [V, 3] float32, model space.

    Raises:
        ValueError: `every` is less than 1.
        SessionError: The file is no session, is damaged, or is one of another mesh.
        OSError: It can't be read.
    """
    if every < 1:
        raise ValueError(f"every is {every}; give the ticks from pose to pose, at least 1")
    start_warp()
    session = load_session(Path(path), field)
    scene = Scene(field, Path(path).stem, device)
    player = Player(scene, session)
    for tick in range(0, session.ticks + 1, every):
        player.play_to(tick)
        yield scene.positions.copy()


def _infinite(material):
    return {name: math.inf if value is None else value for name, value in material.items()}
