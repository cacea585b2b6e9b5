"""What a drag of the mouse does to what is held: move it, turn it or scale it.

It may be held to an axis, to a plane across it, and to a number that is typed instead of a way.
Lengths that are typed are in object sizes, angles in degrees, scales are factors.  Pixels are the
image's, x to the right, y down.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..camera import onto_view_plane, project, ray
from ..document import rotation_matrix, rotation_vector, stretched

MOVE, TURN, SCALE = KINDS = "move", "turn", "scale"
WORDS = {MOVE: "along", TURN: "about", SCALE: "along"}
UNITS = {MOVE: " of the size", TURN: "°", SCALE: " times"}
DIGITS = {MOVE: 3, TURN: 1, SCALE: 3}  # behind the point, of what the mouse says
ALONG = 0.1  # the sine of the least angle between a ray and the axis, or plane, of a move
FARTHEST_DRAG = 5.0  # object sizes from the start, along an axis or in a plane
LONGEST_NUMBER = 10  # characters
NEAR = 25.0  # points from the center: nearer, only the way to the right counts
TURN_PER_POINT = 1.0 / 80.0  # radians, if the press was near the center
MOST_DEGREES = 36000.0  # that a number can ask for
SCALE_PER_POINT = 1.0 / 150.0  # of the logarithm, if the press was near the center
SCALES = 0.1, 10.0
BEHIND = "it is behind the eye: turn around first (Home)"
NOTHING = "nothing to {}: select red points, or point at one"


@dataclass
class Constraint:
    """What one drag is held to.

    Axes are model space's or the own ones of what is dragged.
    """

    own: np.ndarray = field(default_factory=lambda: np.eye(3))  # axes, in columns  [3, 3]
    axis: int | None = None  # 0, 1, 2: this axis only; None: any
    across: bool = False  # the plane across the axis instead
    is_own: bool = False  # one of its own axes
    text: str = ""  # what was typed
    # Where a ring was pressed that is seen from its side: pixels of the way per radian.  [2]
    tangent: np.ndarray | None = None

    @property
    def axes(self) -> np.ndarray:
        """In columns.  [3, 3]"""
        return self.own if self.is_own else np.eye(3)

    @property
    def along(self) -> np.ndarray | None:
        """The axis, a unit vector.  [3]"""
        return None if self.axis is None else self.axes[:, self.axis]

    @property
    def typed_axis(self) -> np.ndarray:
        """Along which a length that is typed goes: x, if the hand is free.  [3]"""
        if self.across:
            return self.axes[:, (self.axis + 1) % 3]
        return self.axes[:, self.axis or 0]

    @property
    def number(self) -> float | None:
        """What was typed, if it is a number so far."""
        return number_of(self.text) if self.text else None

    def choose(self, axis: int, across: bool = False) -> None:
        """Hold to an axis; to its own one if it was that already; then to nothing."""
        self.tangent, same = None, (self.axis, self.across) == (axis, across)
        if same and self.is_own:
            self.axis, self.across, self.is_own = None, False, False
        else:
            self.axis, self.across, self.is_own = axis, across, same

    def type(self, character: str) -> bool:
        """Take a character of a number, or "\\b", which takes the last one away; whether it is one.

        A minus sign turns the number over, wherever it is typed.
        """
        text = self.text
        if character == "\b":
            text = text[:-1]
        elif character == "-":
            text = text[1:] if text.startswith("-") else f"-{text}"
        elif character in tuple(".,"):
            text += "." * ("." not in text)
        elif character in tuple("0123456789"):
            text += character
        else:
            return False
        self.text = text[:LONGEST_NUMBER]
        return True

    def words(self, kind: str, amount: float | None) -> str:
        """What is done, and by how much: "move along x: 0.12 of the size"."""
        line = kind
        if self.axis is not None:
            names = "xyz".replace("xyz"[self.axis], "") if self.across else "xyz"[self.axis]
            line += f" {WORDS[kind]} {'its own ' * self.is_own}{names}"
        if self.text:
            return f"{line}: {self.text}_{UNITS[kind]}"
        if amount is None:
            return line
        amount = round(amount, DIGITS[kind]) + 0.0  # no -0
        return f"{line}: {amount:.{DIGITS[kind]}f}{UNITS[kind]}"

    def place(self, camera, aim, start, now, size: float) -> np.ndarray:
        """Where something that began at `start` [3] and is at `now` [3] goes, to be at a pixel.

        Args:
            aim: The pixel.  [2]
            size: The object's [model units].
        """
        if self.number is not None:
            most = FARTHEST_DRAG * size
            return start + np.clip(self.number * size, -most, most) * self.typed_axis
        if self.axis is None:
            return onto_view_plane(camera, aim, now)
        find = on_plane if self.across else on_axis
        place = find(ray(camera, aim), start, self.along)
        if place is None:
            return now
        way = place - start
        return start + way * min(1.0, FARTHEST_DRAG * size / max(np.linalg.norm(way), 1e-12))

    def length(self, way, size: float) -> float:
        """How far a way [3] goes: along the axis, or at all [object sizes]."""
        free = self.number is None and (self.axis is None or self.across)
        return float(np.linalg.norm(way) if free else way @ self.typed_axis) / size

    def turn_axis(self, camera) -> np.ndarray:
        """About which a turn goes by the right hand's rule: the way to the eye, if free.  [3]"""
        return -camera.forward if self.axis is None else self.along

    def angle(self, camera, center, press, pixel, ratio: float, before: float) -> float:
        """By how much to turn about `turn_axis` [radians], as near as can be to before.

        Args:
            center: About which it turns.  [3]
            press, pixel: Where the turn began and where the mouse is.  [2] each
            ratio: Pixels per point.
        """
        if self.number is not None:
            return math.radians(np.clip(self.number, -MOST_DEGREES, MOST_DEGREES))
        if self.tangent is not None:
            return float((pixel - press) @ self.tangent / (self.tangent @ self.tangent))
        axis, (middle,) = self.turn_axis(camera), project(camera, center[None])[0]
        sign = 1.0 if axis @ camera.forward >= 0.0 else -1.0  # clockwise as it is seen is positive
        since, now = press - middle, pixel - middle
        if not np.linalg.norm(since) >= NEAR * ratio:
            return float(sign * (pixel[0] - press[0]) / ratio * TURN_PER_POINT)
        if self.axis is not None:
            ends = [on_plane(ray(camera, one), center, axis) for one in (press, pixel)]
            if all(one is not None for one in ends):
                u, v = (one - center for one in ends)
                return unwound(before, float(axis @ np.cross(u, v)), float(u @ v))
        cross = float(since[0] * now[1] - since[1] * now[0])
        return sign * unwound(sign * before, cross, float(since @ now))


def number_of(text: str) -> float | None:
    """The number that a text is, unless it is none or not finite.

    >>> number_of("-.5"), number_of("-"), number_of("1e400"), number_of("nan")
    (-0.5, None, None, None)
    """
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def on_axis(ray, start, along):
    """The point nearest to a ray on the line through `start` [3]; None if they are parallel."""
    eye, direction = ray
    across = direction - (direction @ along) * along  # of the ray, seen along the axis
    if np.linalg.norm(across) < ALONG:
        return None
    away = eye - np.asarray(start)
    t = -(away @ across) / (across @ across)
    return start + ((away + t * direction) @ along) * along


def on_plane(ray, start, normal):
    """Where a ray meets the plane through `start` [3]; None if it is nearly in the plane."""
    eye, direction = ray
    steep = direction @ normal
    if abs(steep) < ALONG:
        return None
    return eye + ((np.asarray(start) - eye) @ normal / steep) * direction


def unwound(before: float, sine: float, cosine: float) -> float:
    """The angle with that sine and cosine, in any unit, as near as can be to the one before."""
    return before + math.remainder(math.atan2(sine, cosine) - before, math.tau)


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
