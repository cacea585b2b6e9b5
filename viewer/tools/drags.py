"""What a drag of the mouse does to what is held: move it, turn it or scale it.

Pixels are the image's, x to the right, y down.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..camera import project
from ..document import rotation_matrix, rotation_vector, stretched
from .constraints import MOVE, NEAR, TURN, Constraint

SCALE_PER_POINT = 1.0 / 150.0  # of the logarithm, if the press was near the center
SCALES = 0.1, 10.0
BEHIND = "it is behind the eye: turn around first (Home)"
NOTHING = "nothing to {}: select red points, or point at one"


@dataclass
class Drag:
    """A drag by the mouse: of handles, or of what a kind of its own says."""

    press: np.ndarray  # the pixel where the present kind began  [2]
    miss: np.ndarray  # from what follows the mouse to the first press [pixels]  [2]
    kind: str = MOVE  # one of KINDS
    held: Constraint = field(default_factory=Constraint)
    # What follows the mouse, as an offset from the place of what is held.  [3]
    anchor: np.ndarray = field(default_factory=lambda: np.zeros(3))
    before: Any = None  # the Motion, or a bone's pose, when the present kind began
    angle: float = 0.0  # so far [radians]
    amount: float | None = None  # so far: object sizes, degrees or a factor

    @property
    def line(self) -> str:
        """What it does, in words."""
        return self.held.words(self.kind, self.amount)

    @property
    def is_plain(self) -> bool:
        """Whether it moves freely: there are no axis and no amount to show."""
        return self.kind == MOVE and self.held.axis is None and not self.held.text

    def begin(self, kind: str, now, camera, pixel, place) -> None:
        """Go on in another way from where the mouse and what is held are now.

        Args:
            now: What `before` says from now on.
            place: What follows the mouse.  [3]
        """
        self.kind, self.press, self.angle = kind, np.array(pixel, float), 0.0
        self.before, self.amount, self.miss = now, None, miss_of(camera, pixel, place)
        self.held.text, self.held.tangent = "", None

    def led(self, camera, pixel, start, now, size: float) -> np.ndarray:
        """Where what began at `start` and is at `now` goes, to be under the mouse.  All [3]

        Args:
            size: The object's [model units].
        """
        place = self.held.place(camera, pixel - self.miss, start, now, size)
        if not np.isfinite(place).all():
            return now
        self.amount = self.held.length(place - start, size)
        return place

    def turn(self, camera, center, pixel, ratio: float) -> np.ndarray:
        """By which the mouse turns what is held about a center [3], axis times angle.  [3]"""
        self.angle = self.held.angle(camera, center, self.press, pixel, ratio, self.angle)
        self.amount = math.degrees(self.angle)
        return self.angle * self.held.turn_axis(camera)


def miss_of(camera, pixel, place) -> np.ndarray:
    """From where a place [3] shows to a pixel; 0 if it is behind the eye.  [2]"""
    (at,), _ = project(camera, np.asarray(place)[None])
    return np.nan_to_num(pixel - at)


def is_ahead(camera, place) -> bool:
    """Whether a place [3] is in front of the eye."""
    pixels, t = project(camera, np.asarray(place)[None])
    return bool(np.isfinite(pixels).all() and t[0] > 0.0)


def follow(drag: Drag, handles, camera, pixel, ratio: float) -> None:
    """Send what is held to where the mouse is.  `ratio`: pixels per point."""
    motion = handles.grabbed.target
    if drag.kind == MOVE:
        start, now = handles.grabbed.start + drag.anchor, motion.place + drag.anchor
        handles.drag_to(drag.led(camera, pixel, start, now, handles.size) - drag.anchor)
        return
    before, center = drag.before, motion.place + motion.center
    if drag.kind == TURN:
        rotation = rotation_matrix(drag.turn(camera, center, pixel, ratio))
        turned = rotation_vector(rotation @ rotation_matrix(before.rotation))
        handles.turn_to(turned, before.scale, before.stretch)
        return
    (middle,), _ = project(camera, center[None])
    since, now = drag.press - middle, pixel - middle
    if not np.linalg.norm(since) >= NEAR * ratio:  # also where the middle is behind the eye
        _scale(drag, handles, math.exp((pixel[0] - drag.press[0]) / ratio * SCALE_PER_POINT))
    else:
        _scale(drag, handles, float(np.linalg.norm(now) / np.linalg.norm(since)))


def _scale(drag, handles, wider):
    """Scale what is held by a factor, or by the one that was typed: all of it, or along axes."""
    before, number = drag.before, drag.held.number
    factor = float(np.clip(wider if number is None or number <= 0.0 else number, *SCALES))
    drag.amount = factor
    along = drag.held.along
    if along is None:
        scale = float(np.clip(before.scale * factor, *SCALES))
        handles.turn_to(before.rotation, scale, before.stretch)
        return
    flat = np.outer(along, along)
    own, others = (1.0, factor) if drag.held.across else (factor, 1.0)
    rotation, stretch = stretched(before, own * flat + others * (np.eye(3) - flat), SCALES)
    handles.turn_to(rotation, before.scale, stretch)
