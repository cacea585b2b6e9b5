"""What a drag of the mouse does to what is held: move it, turn it or scale it.

Pixels are the image's, x to the right, y down.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from ..camera import onto_view_plane, project, ray
from ..scene import rotation_matrix, rotation_vector

MOVE, TURN, SCALE = KINDS = "move", "turn", "scale"
NEAR = 25.0  # points from the center: nearer, only the way to the right counts
TURN_PER_POINT = 1.0 / 80.0  # radians, if the press was near the center
SCALE_PER_POINT = 1.0 / 150.0  # of the logarithm, likewise
SCALES = 0.1, 10.0
ALONG = 0.1  # the sine of the least angle between a ray and the axis that it moves along
FARTHEST_DRAG = 5.0  # object sizes from the start, along an axis


@dataclass
class Drag:
    """A drag of handles by the mouse."""

    press: np.ndarray  # the pixel where the present kind began  [2]
    miss: np.ndarray  # from the grabbed sphere's center to the first press [pixels]  [2]
    kind: str = MOVE  # one of KINDS
    axis: int | None = None  # 0, 1, 2: along or about this axis of model space only
    rotation: np.ndarray = field(default_factory=lambda: np.zeros(3))  # before this kind began
    scale: float = 1.0  # before this kind began
    angle: float = 0.0  # so far [radians]

    @property
    def line(self) -> str:
        """What it does, in words."""
        if self.axis is None or self.kind == SCALE:
            return self.kind
        return f"{self.kind} {'along' if self.kind == MOVE else 'about'} {'xyz'[self.axis]}"

    def begin(self, kind: str, motion, pixel) -> None:
        """Go on in another way from where the mouse and what is held are now."""
        self.kind, self.press, self.angle = kind, np.array(pixel, float), 0.0
        self.rotation, self.scale = motion.rotation, motion.scale


def follow(drag: Drag, handles, camera, pixel, ratio: float) -> None:
    """Send what is held to where the mouse is.  `ratio`: pixels per point."""
    motion = handles.grabbed.target
    if drag.kind == MOVE:
        aim = pixel - drag.miss
        if drag.axis is None:
            handles.drag_to(onto_view_plane(camera, aim, motion.place))
        else:
            start, most = handles.grabbed.start, FARTHEST_DRAG * handles.size
            place = on_axis(ray(camera, aim), start, drag.axis)
            near = motion.place if place is None else np.clip(place, start - most, start + most)
            handles.drag_to(near)
        return
    (center,), _ = project(camera, (motion.place + motion.center)[None])
    since, now = drag.press - center, pixel - center
    near = np.linalg.norm(since) < NEAR * ratio
    right = (pixel[0] - drag.press[0]) / ratio
    if drag.kind == TURN:
        drag.angle = right * TURN_PER_POINT if near else unwound(drag.angle, since, now)
        turned = rotation_matrix(drag.angle * turn_axis(camera, drag.axis))
        rotation = rotation_vector(turned @ rotation_matrix(drag.rotation))
        handles.turn_to(rotation, motion.scale)
    else:
        wider = math.exp(right * SCALE_PER_POINT)
        if not near:
            wider = float(np.linalg.norm(now) / np.linalg.norm(since))
        handles.turn_to(motion.rotation, float(np.clip(drag.scale * wider, *SCALES)))


def on_axis(ray, start, axis: int):
    """The point nearest to a ray on the line through `start` [3]; None if they are parallel."""
    eye, direction = ray
    along = np.eye(3)[axis]
    across = direction - (direction @ along) * along  # of the ray, seen along the axis
    if np.linalg.norm(across) < ALONG:
        return None
    away = eye - np.asarray(start)
    t = -(away @ across) / (across @ across)
    return start + ((away + t * direction) @ along) * along


def turn_axis(camera, axis: int | None):
    """About which to turn, so that what is held follows the mouse around its center.  [3]"""
    if axis is None:
        return camera.forward
    along = np.eye(3)[axis]
    return along if along @ camera.forward >= 0.0 else -along


def unwound(before: float, since, now) -> float:
    """The angle from one direction to another [2] each, as near as can be to the one before."""
    angle = math.atan2(since[0] * now[1] - since[1] * now[0], float(since @ now))
    return before + math.remainder(angle - before, math.tau)
