"""Where a scene is looked at from: the orbit, the first view, the object in the frame.

Moves of the camera are no edits: they are recorded as views, and undo leaves them.  Views that
are saved under a name are edits.
"""

from dataclasses import replace
from typing import Protocol

import numpy as np

from ...camera import Orbit, changed, framed, values_of
from ..history.journal import Edited, edit
from .surface import bounds

MARGIN = 0.62  # of a framed object's size: the radius of the ball that fills the image
DEPTH_PART = 0.75  # of its size, that the object may reach from its center towards the eye
LONGEST_NAME = 60  # characters
FARTHEST_TARGET = 500.0  # model units from the origin, along an axis
FIRST_VIEW = Orbit(yaw=np.radians(30.0), pitch=np.radians(14.0))


def clean_name(text: str) -> str:
    """A name that a session can keep: one line of characters that can be read."""
    return "".join(filter(str.isprintable, text)).strip()[:LONGEST_NAME]


class Pointed(Protocol):
    """Handles, perhaps one under the mouse."""

    hover: int | None

    def at(self, ids) -> np.ndarray: ...


class Viewed(Protocol):
    """The object that is looked at."""

    center: np.ndarray  # at rest  [3]
    size: float
    seen_points: np.ndarray  # [N, 3]
    handles: Pointed


class Viewpoint(Edited):
    """The camera of one object; `orbit` is what it is now.

    Attributes:
        depth_range: Distances from the eye between which the object lies at rest, whatever its
            shape.
    """

    kept = ("saved",)

    def __init__(self, viewed: Viewed):
        self._viewed = viewed
        self.orbit = FIRST_VIEW
        self.saved = {}  # name: the values of an Orbit, as JSON has them; never changed in place
        self.new_name = ""  # that the user types for the next one
        self._last = ""  # that was gone to or saved
        self.home()

    def home(self) -> None:
        """The first view: the whole object at rest; what is up stays, and parallel rays do."""
        first = replace(FIRST_VIEW, up=self.orbit.up, parallel=self.orbit.parallel)
        self.orbit = framed(first, self._viewed.center, MARGIN * self._viewed.size)

    def focus(self) -> None:
        """Frame the object as it is now, or turn about the vertex under the mouse."""
        handles = self._viewed.handles
        if handles.hover is not None:
            (target,) = handles.at([handles.hover])
            self.orbit = replace(self.orbit, target=target)
            return
        low, high = bounds(self._viewed.seen_points)
        radius = MARGIN * float((high - low).max())
        self.orbit = framed(self.orbit, 0.5 * (low + high), radius)

    @property
    def orbit(self) -> Orbit:
        return self._orbit

    @orbit.setter
    def orbit(self, orbit: Orbit):
        """However far a user pans: a session keeps no camera beyond."""
        target = np.clip(orbit.target, -FARTHEST_TARGET, FARTHEST_TARGET)
        orbit = orbit if (target == orbit.target).all() else replace(orbit, target=target)
        viewed, pose = self._viewed, orbit.pose
        away = float(np.linalg.norm(pose[:3, 3] - viewed.center))
        if orbit.parallel:
            away = float((pose[:3, 3] - viewed.center) @ pose[:3, 2])
        reach = DEPTH_PART * viewed.size
        self._orbit, self.depth_range = orbit, (max(away - reach, 0.0), away + reach)

    # -- views with a name ---------------------------------------------------------------

    def save(self) -> str:
        """Save this view under the name that was typed, or the next number; returns it."""
        name = clean_name(self.new_name)
        numbers = (f"view {n}" for n in range(1, len(self.saved) + 2))
        name = name or next(n for n in numbers if n not in self.saved)
        self.new_name, self._last = "", name
        self._save(name, values_of(self.orbit))
        return name

    @edit("save_view", undo="save the view {name}")
    def _save(self, name, view):
        self.saved = self.saved | {name: view}

    @edit("delete_view", undo="delete the view {name}")
    def delete(self, name: str) -> None:
        self.saved = {key: view for key, view in self.saved.items() if key != name}

    def go_to(self, name: str) -> None:
        self.orbit, self._last = changed(self.orbit, self.saved[name]), name

    def next(self) -> str:
        """Look from the saved view after the last one; returns its name, empty if none is saved."""
        names = list(self.saved)
        if not names:
            return ""
        at = names.index(self._last) + 1 if self._last in names else 0
        self.go_to(names[at % len(names)])
        return self._last
