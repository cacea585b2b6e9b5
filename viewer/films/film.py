"""Films: frames of a session, or of a turn around the object, one after another in full.

A film's second is 60 ticks of the object's time, however long they took when they were made.
Between two views that follow each other closely the camera moves evenly, since a slow machine
noted only some of them.
"""

import math
from bisect import bisect_right
from dataclasses import fields
from pathlib import Path

import numpy as np

from ...core.deform import TIME_STEP
from ...core.render import Camera
from ..camera import Orbit, changed, turned_to
from ..document import (
    KEY,
    TICKS_PER_SECOND,
    CameraKey,
    Event,
    Patience,
    Player,
    Session,
    SessionError,
    load_session,
    orbit_at,
    play_patiently,
)
from .sight import seen_by, without_lens
from .still import load_vertices

ROUNDING = 1e-6  # ticks
CLOSE = 20  # ticks between two views of one move
SETTLED = 1  # times that a soft clip is played before the film begins, so that it repeats


class Views:
    """The camera of a session at any time."""

    def __init__(self, session: Session, first: Orbit):
        """Take a session, and the camera until its first view."""
        names = {f.name for f in fields(Orbit)}
        self._keys = [CameraKey(0, first, "linear")]
        for event in session.events:
            orbit = self._keys[-1].orbit
            values = {k: v for k, v in event.arguments.items() if k in names}
            if event.name == "view" and values:
                self._add(event.tick, changed(orbit, values))
            elif event.name in ("play", "turntable"):  # until then, the camera stays
                self._add(event.tick, orbit)

    def _add(self, tick, orbit):
        if tick == self._keys[-1].tick:
            self._keys.pop()
        self._keys.append(CameraKey(tick, orbit, "linear"))

    def at(self, tick: float) -> Orbit:
        """The camera when so many ticks have passed; it turns the shorter way around.

        There is no way between two directions that are up, or between two kinds of camera.
        """
        after = bisect_right(self._keys, tick, key=lambda key: key.tick)
        pair = self._keys[max(after - 1, 0) : after + 1]
        first, last = pair[0], pair[-1]
        kinds = {(key.orbit.up, key.orbit.parallel) for key in pair}
        if last.tick - first.tick > CLOSE or len(kinds) > 1:
            return first.orbit
        return orbit_at(pair, tick)


def frame_count(seconds: float, fps: int) -> int:
    """The frames of so many seconds; the last one shows their end."""
    return math.ceil(seconds * fps - 1e-6) + 1


def clip_session(rigging, name: str, softness: float, seconds: float | None):
    """A session in which a clip plays again and again from its beginning, as a hand plays it.

    Args:
        rigging: That has the clip, of a scene at rest.
        seconds: How long the film is; None: as long as the clip.

    Returns:
        The session, the tick at which the film begins, and how long it is [s].

    Raises:
        SessionError: The model has no such clip.
    """
    names = [clip.name for clip in rigging.clips]
    if name not in names:
        others = f"its clips are {', '.join(names)}" if names else "it has none"
        raise SessionError(f"the model has no clip {name!r}: {others}")
    duration = rigging.clip(name).duration
    seconds = max(duration, TIME_STEP) if seconds is None else seconds
    begin = round(SETTLED * duration * TICKS_PER_SECOND) if softness > 0.0 else 0
    ticks = begin + math.ceil(seconds * TICKS_PER_SECOND)
    events = [
        Event(0, "set_softness", {"softness": softness}),
        Event(0, "play_clip", {"clip": name}),
    ]
    return Session({KEY: 1, "start": {}, "ticks": ticks}, events), begin, seconds


def with_timeline(player: Player) -> tuple[Session, int]:
    """A session that goes on by playing its timeline once, and the tick at which that begins.

    Args:
        player: Of the session; its scene is used, and at rest again.

    Raises:
        SessionError: The session has no timeline, or can't be played.
    """
    scene, session = player.scene, player.session
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
        self._playing = playing
        self._player = None if session is None else playing(scene, session)
        self._home = scene.orbit
        self._views = None if session is None else Views(session, scene.orbit)
        self._ticks = 0 if session is None else session.ticks
        self.first, self.last = 0, self._ticks  # that are shown
        # Of ticks, for the times between: vertices [V, 3], and how the timeline moves the camera.
        self._played = {}

    def strike(self, path: Path) -> None:
        """Bring the object into the pose of a file, in which it stays, as there is no session.

        Args:
            path: Of a session (.jsonl), whose last pose it is, seen as there; or of vertices.

        Raises:
            ValueError: The file has no pose of this model (SessionError, PoseError).
            OSError: It can't be read.
        """
        scene = self.scene
        if path.suffix == ".jsonl":
            session = load_session(path, scene.field)
            play_patiently(self._playing(scene, session), session.ticks)
            scene.handles.release()
            scene.end_push()
        else:
            vertices = load_vertices(path, scene.field.mesh.vertex_count)
            scene.solver.set_state(vertices, np.zeros_like(vertices))
        scene.look(0.0)
        self._home = scene.orbit

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
            turns = (tick - self.first) / TICKS_PER_SECOND / self._turn
            return turned_to(self._home, self._home.yaw + 2.0 * np.pi * turns)
        before = math.floor(tick + ROUNDING)
        _, way = self._played.get(before, (None, None))
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
            self._played[now] = self.scene.positions, self.scene.timeline.way_of_camera()
        self._played = {at: found for at, found in self._played.items() if at >= oldest}

    def _vertices(self, tick):
        """The vertices between two ticks, on straight ways.  [V, 3]; None without a session"""
        if self._player is None:
            return None
        before = math.floor(tick + ROUNDING)
        share = tick - before
        if share < ROUNDING:
            return self._played[before][0]
        self._play_to(before + 1)
        return (1.0 - share) * self._played[before][0] + share * self._played[before + 1][0]
