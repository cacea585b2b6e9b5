"""The object's time: which steps a frame takes, and whether time is stopped.

The solver always steps by 1/60 s, since another length would make it compute its coefficients
anew; a frame takes as many steps as fit in it.
"""

from typing import Protocol

from ....core.deform import TIME_STEP, XpbdSolver
from ...settings import Settings
from ..history.journal import Edited, Journal, edit
from .body import Body
from .grabs import Ball, Grab

MAX_STEPS = 6  # a frame; below 10 frames a second the object's time runs slower than the clock


class Dragged(Protocol):
    """Handles, one of them perhaps held."""

    grabbed: Grab | None

    def follow(self, share: float = 1.0) -> None: ...


class PlayedTimeline(Protocol):
    """A timeline."""

    playing: bool
    stands: bool
    shows_poses: bool

    def advance(self) -> bool: ...
    def stand(self) -> None: ...


class MovingBones(Protocol):
    """Bones, and the clip that plays."""

    playing: bool
    shows: bool

    def advance(self, seen: bool) -> bool: ...
    def follow(self, share: float = 1.0) -> None: ...
    def stop_clip(self) -> None: ...
    def give_way(self) -> None: ...


class Timed(Protocol):
    """The object that time moves."""

    solver: XpbdSolver
    settings: Settings
    journal: Journal
    ball: Ball | None
    body: Body
    handles: Dragged
    timeline: PlayedTimeline
    posing: MovingBones

    def follow_ball(self, share: float) -> None: ...
    def note_view(self) -> None: ...
    def look(self) -> None: ...


class Clock(Edited):
    """The time of one object."""

    def __init__(self, timed: Timed):
        self._timed = timed
        self._paused = self._settling = False
        self._time = 0.0  # s that frames have lasted and no step has covered

    @property
    def moving(self) -> bool:
        """Whether time, or a hand while it is stopped, changes the pose."""
        timed = self._timed
        return timed.timeline.playing or timed.posing.playing or self._goes_on

    @property
    def waits(self) -> bool:
        """Whether a step would wait seconds for what it needs, which a thread works out."""
        timed = self._timed
        playing = timed.timeline.playing or timed.posing.playing
        if timed.solver.ready or playing or not self._goes_on:
            return False
        timed.solver.edges.sheet_ratios.begin()
        return True

    @property
    def _goes_on(self):
        """Whether the solver moves the object.

        While time is stopped, it does if a hand poses the object, or has and it isn't still yet.
        """
        timed, ball = self._timed, self._timed.ball
        if not timed.solver.settled:
            holds = self._settling or timed.handles.grabbed is not None
            return not self._paused or (timed.settings.hand == "pose" and holds)
        return not self._paused and ball is not None and ball.on_its_way

    def advance(self, seconds: float) -> None:
        """Let time pass; the object moves unless it rests or is paused."""
        timed = self._timed
        timed.note_view()
        timed.body.adapt_substeps()
        self._time += seconds
        count = min(round(self._time / TIME_STEP), MAX_STEPS)
        self._time = min(self._time - count * TIME_STEP, TIME_STEP)
        self._settling = self._paused and self._goes_on
        if self._paused:
            timed.posing.follow()
            if count and self._settling:  # what a hand poses takes the rest along
                timed.handles.follow()
                self._settle(count)
        for remaining in range(count, 0, -1):  # each tick takes its share of the way
            if not self._paused:
                timed.handles.follow(1.0 / remaining)
                timed.posing.follow(1.0 / remaining)
                timed.follow_ball(1.0 / remaining)
            self.tick(seen=remaining == 1)
        timed.look()

    @edit("settle")
    def _settle(self, count):
        """Go on to the equilibrium by so many steps, each from standing still."""
        for _ in range(count):
            self._timed.solver.step(TIME_STEP)
            self._timed.solver.velocities.zero_()

    def tick(self, seen: bool = True) -> None:
        """Let a tick pass: a step, if the object moves and isn't moved by timeline or clip.

        Args:
            seen: Whether the pose after it is looked at; where it follows from the time alone,
                it is left out otherwise.
        """
        timed = self._timed
        by_timeline, by_clip = timed.timeline.advance(), timed.posing.advance(seen)
        if not (by_timeline or by_clip or self._paused) and self._goes_on:
            timed.solver.step(TIME_STEP)
        timed.journal.tick += 1

    @property
    def paused(self) -> bool:
        return self._paused

    @paused.setter
    def paused(self, paused: bool):
        self._pause(paused)

    @edit("pause")
    def _pause(self, on):
        timed = self._timed
        if timed.timeline.shows_poses:  # time stands still already: the playhead does, too
            timed.timeline.stand()
            return
        if timed.posing.shows:
            timed.posing.stop_clip()
            return
        if not on:
            timed.posing.give_way()
        self._paused = on
        timed.timeline.stands = False

    def single_step(self) -> None:
        """Pause, and take one step."""
        timed = self._timed
        self.paused = True
        timed.handles.follow()
        timed.follow_ball(1.0)
        self._single_step()
        timed.look()

    @edit("single_step")
    def _single_step(self):
        self._timed.solver.step(TIME_STEP)
