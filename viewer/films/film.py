"""Films: frames of a session, or of a turn around the object, one after another in full.

A film's second is 60 ticks of the object's time, however long they took when they were made.
Between two views that follow each other closely the camera moves evenly, since a slow machine
noted only some of them.
"""

import math
from bisect import bisect_right
from dataclasses import fields, replace

import numpy as np

from ...core.render import Camera
from ..camera import Orbit, changed
from ..document import (
    TICKS_PER_SECOND,
    CameraKey,
    Patience,
    Player,
    Session,
    SessionError,
    orbit_at,
    play_patiently,
)
from .sight import seen_by, without_lens

ROUNDING = 1e-6  # ticks
CLOSE = 20  # ticks between two views of one move


class Views:
    """The camera of a session at any time."""

    def __init__(self, session: Session, first: Orbit):
        """Take a session, and the camera until its first view."""
        names = {f.name for f in fields(Orbit)}
        self._ticks, self._orbits = [0], [first]
        for event in session.events:
            if event.name in ("play", "turntable"):  # until then, the camera stays
                self._add(event.tick, self._orbits[-1])
            values = {k: v for k, v in event.arguments.items() if k in names}
            if event.name == "view" and values:
                self._add(event.tick, changed(self._orbits[-1], values))

    def _add(self, tick, orbit):
        if tick == self._ticks[-1]:
            self._orbits[-1] = orbit
        else:
            self._ticks.append(tick)
            self._orbits.append(orbit)

    def at(self, tick: float) -> Orbit:
        """The camera when so many ticks have passed."""
        before = max(bisect_right(self._ticks, tick) - 1, 0)
        if before + 1 == len(self._ticks):
            return self._orbits[-1]
        since, until = self._ticks[before : before + 2]
        if until - since > CLOSE:
            return self._orbits[before]
        return between(*self._orbits[before : before + 2], (tick - since) / (until - since))


def between(first: Orbit, second: Orbit, share: float) -> Orbit:
    """The camera on its way from one to another; it turns the shorter way around.

    There is no way between two directions that are up, or between two kinds of camera.
    """
    if (first.up, first.parallel) != (second.up, second.parallel):
        return first
    values = {
        name: (1.0 - share) * getattr(first, name) + share * getattr(second, name)
        for name in ("target", "distance", "pitch", "field_of_view")
    }
    for name in ("yaw", "roll"):
        turn = (getattr(second, name) - getattr(first, name) + np.pi) % (2.0 * np.pi) - np.pi
        values[name] = getattr(first, name) + share * turn
    return replace(first, **values)


def turned_around(orbit: Orbit, share: float) -> Orbit:
    """The camera after a share of a turn around its target."""
    return replace(orbit, yaw=orbit.yaw + 2.0 * np.pi * share)


def frame_count(seconds: float, fps: int) -> int:
    """The frames of so many seconds; the last one shows their end."""
    return math.ceil(seconds * fps - 1e-6) + 1


def with_timeline(scene, session: Session, playing=Player) -> tuple[Session, int]:
    """A session that goes on by playing its timeline once, and the tick at which that begins.

    Args:
        scene: At rest; it is used, and at rest again.
        playing: Makes a Player of a scene and a session.

    Raises:
        SessionError: The session has no timeline, or can't be played.
    """
    player = playing(scene, session)
    play_patiently(player, session.ticks)
    timeline, begin = scene.timeline, scene.journal.tick
    if not timeline.end:
        raise SessionError("--timeline has nothing to show: the session's timeline has no keys")
    timeline.set_loop(False)
    timeline.scrub(0)
    timeline.play()
    end, patience = begin + timeline.end, Patience("playing the timeline", timeline.end)
    for tick in player.adapting(end):
        patience.heed(tick - begin)
    scene.note_view()
    events = list(scene.journal.events)
    scene.states.begin_anew()
    return Session(session.header | {"ticks": end}, events), begin


class Film:
    """What each frame of a film shows: it sets the scene, and says from where it is seen."""

    def __init__(
        self,
        scene,
        session: Session | None,
        fps: int,
        turn: float | None = None,
        path: tuple[CameraKey, ...] = (),
        playing=Player,
    ):
        """Take a scene at rest.

        Args:
            session: What is played; None: the object stays as it is.
            turn: Seconds of a turn around the object; with a session, its camera instead.
            path: Keys of the camera, instead of the session's and of a turn.
            playing: Makes a Player of a scene and a session.

        Raises:
            SessionError: The session can't be played.
        """
        self.scene, self.fps, self._turn, self._path = scene, fps, turn, path
        self._player = None if session is None else playing(scene, session)
        self._home = scene.orbit
        self._views = None if session is None else Views(session, scene.orbit)
        self._ticks = 0 if session is None else session.ticks
        self.first, self.last = 0, self._ticks  # that are shown
        self._poses = {}  # vertices [V, 3] at ticks, for the times between
        self._ways = {}  # of the camera from these ticks on, where the timeline moves it

    def cut(self, first: int | None, last: int | None) -> None:
        """Show these ticks alone; a ValueError if the session has none of them."""
        first, end = first or 0, self._ticks
        if first > end or (last is not None and last < first):
            until = end if last is None else last
            raise ValueError(f"there is nothing from tick {first} to {until}: it has {end} ticks")
        self.first, self.last = first, end if last is None else min(last, end)

    @property
    def count(self) -> int:
        """The number of frames."""
        if self._player is None and self._path:
            return frame_count(self._path[-1].tick / TICKS_PER_SECOND, self.fps)
        if self._player is None:
            return frame_count(self._turn, self.fps) - 1  # the last one would be the first again
        return frame_count((self.last - self.first) / TICKS_PER_SECOND, self.fps)

    def tick(self, frame: float) -> float:
        """The ticks that have passed when a frame is shown; there are times between frames."""
        tick = self.first + frame * TICKS_PER_SECOND / self.fps
        return tick if self._player is None else min(max(tick, self.first), self.last)

    def orbit(self, tick: float) -> Orbit:
        """The camera after so many ticks; where the timeline moves it, they have been played."""
        if self._path:
            return orbit_at(self._path, tick - self.first)
        if self._turn is not None:
            seconds = (tick - self.first) / TICKS_PER_SECOND
            return turned_around(self._home, seconds / self._turn)
        before = math.floor(tick + ROUNDING)
        way = self._ways.get(before)
        return self._views.at(tick) if way is None else way(max(tick - before, 0.0))

    def camera(self, tick: float, width: int, height: int) -> Camera:
        """The same as the camera of an image."""
        return seen_by(self.orbit(tick), width, height)

    def show(self, frame: int) -> None:
        """Set the scene for a frame."""
        self._play_to(math.floor(self.tick(frame) + ROUNDING))
        self.scene.orbit = without_lens(self.orbit(self.tick(frame)))

    def moments(self, frame: int, size, count: int = 1, shutter: float = 0.0) -> list:
        """Say what the images see whose mean a frame is; `show` has set the scene for it.

        Args:
            size: Width and height [pixels].
            count: Of images.
            shutter: The share of a frame's time that they are spread over; it ends when the frame
                is shown, so that the last image sees what a frame without blur shows.

        Returns:
            Of each image its Camera, and vertices [V, 3]; None: as they are in the scene.
        """
        if not shutter or count == 1:
            return count * [(self.camera(self.tick(frame), *size), None)]
        ends = [self.tick(frame + shutter * (i + 1 - count) / count) for i in range(count)]
        return [(self.camera(tick, *size), self._vertices(tick)) for tick in ends]

    def _play_to(self, tick):
        """Play until a tick, and keep poses and cameras of the ticks from the last frame on."""
        if self._player is None:
            return
        journal = self.scene.journal
        oldest = tick - math.ceil(TICKS_PER_SECOND / self.fps) - 1
        play_patiently(self._player, max(oldest, journal.tick))
        for now in range(journal.tick, tick + 1):
            self._player.play_to(now)
            self._poses[now] = self.scene.positions
            self._ways[now] = self.scene.timeline.way_of_camera()
        self._poses = {at: pose for at, pose in self._poses.items() if at >= oldest}
        self._ways = {at: way for at, way in self._ways.items() if at >= oldest}

    def _vertices(self, tick):
        """The vertices between two ticks, on straight ways.  [V, 3]; None without a session"""
        if self._player is None:
            return None
        before = math.floor(tick + ROUNDING)
        share = tick - before
        if share < ROUNDING:
            return self._poses[before]
        self._play_to(before + 1)
        return (1.0 - share) * self._poses[before] + share * self._poses[before + 1]
