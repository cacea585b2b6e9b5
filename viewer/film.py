"""Films: frames of a session, or of a turn around the object, one after another in full.

A film's second is 60 ticks of the object's time, however long they took when they were made.
Between two views that follow each other closely the camera moves evenly, since a slow machine
noted only some of them.
"""

import math
from bisect import bisect_right
from dataclasses import fields, replace

import numpy as np

from .orbit import Orbit, changed
from .session import Player, Session

TICKS_PER_SECOND = 60
CLOSE = 20  # ticks between two views of one move


class Views:
    """The camera of a session at any time."""

    def __init__(self, session: Session, first: Orbit):
        """Take a session, and the camera until its first view."""
        names = {f.name for f in fields(Orbit)}
        self._ticks, self._orbits = [0], [first]
        for event in session.events:
            values = {k: v for k, v in event.arguments.items() if k in names}
            if event.name == "view" and values:
                orbit = changed(self._orbits[-1], values)
                if event.tick == self._ticks[-1]:
                    self._orbits[-1] = orbit
                else:
                    self._ticks.append(event.tick)
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
    """The camera after a part of a turn around its target."""
    return replace(orbit, yaw=orbit.yaw + 2.0 * np.pi * share)


def frame_count(seconds: float, fps: int) -> int:
    """The frames of so many seconds; the last one shows their end."""
    return math.ceil(seconds * fps - 1e-6) + 1


def frames_of(app, session: Session | None, fps: int, turntable: float | None):
    """How many frames a film has, and a function that sets the scene for a frame.

    Args:
        turntable: Seconds of a turn around the object; with a session, its camera instead.
    """
    scene = app.scene
    player = None if session is None else Player(scene, session)
    home, views = scene.orbit, None if session is None else Views(session, scene.orbit)
    seconds = turntable if session is None else session.ticks / TICKS_PER_SECOND
    count = frame_count(seconds, fps)
    count -= session is None  # the last frame would be the first one again

    def show(frame):
        if player is not None:
            tick = min(frame * TICKS_PER_SECOND / fps, session.ticks)
            player.play_to(int(tick + 1e-6))
            scene.orbit = views.at(tick)
        if turntable is not None:
            scene.orbit = turned_around(home, frame / fps / turntable)

    return count, show
