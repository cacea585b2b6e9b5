"""The orbit camera: a target, a distance and angles; every gesture returns a new one.

Pixels are the image's (x to the right, y down, origin at the top left corner), angles are
radians.  Yaw 0 looks along +y where `up` is +z, the object's own; pitch is the eye's height
above the target's horizon.  Parallel rays (an orthographic view) show what lies at the target's
depth as large as it was, and start so far behind the eye that no object is cut.

Moves of the camera are no edits: CameraHistory is their own way back.
"""

from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from ...core.render import Camera, pinhole

STEEPEST = np.radians(89.0)  # where a drag stops: beyond it, left and right are exchanged
CLOSEST, FARTHEST = 0.02, 50.0  # distance from the target, in model units
TURN_PER_HEIGHT = np.pi  # a drag over the height of the image turns by half a turn
BEHIND = 4.0  # model units from the eye back to where parallel rays start
MOST_PAST = 50  # orbits that are kept
APART = 0.7  # s: moves that follow each other sooner are one, as of the wheel
Z_UP = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Orbit:
    """The camera's position and direction."""

    target: np.ndarray = field(default_factory=lambda: np.full(3, 0.5))  # looked at, turned about
    distance: float = 2.0  # from the eye to the target
    yaw: float = 0.0  # about `up`
    pitch: float = 0.0  # above the horizon
    field_of_view: float = float(np.radians(35.0))  # vertical, of the whole image
    roll: float = 0.0  # about the axis of view; a drag ends it
    up: tuple[float, float, float] = Z_UP  # a unit vector
    parallel: bool = False  # orthographic

    @cached_property
    def pose(self) -> np.ndarray:
        """Camera to world; not to be written: it is asked for several times in a frame.  [4, 4]"""
        made, c, s = np.eye(4), np.cos(self.roll), np.sin(self.roll)
        right, up, backward = (upright(self.up) @ level_axes(self.yaw, self.pitch)).T
        made[:3, 0], made[:3, 1], made[:3, 2] = c * right + s * up, c * up - s * right, backward
        away = self.distance + (BEHIND if self.parallel else 0.0)
        made[:3, 3] = self.target + away * backward
        made.flags.writeable = False
        return made


def values_of(orbit: Orbit) -> dict:
    """Its fields, as JSON has them."""
    values = {one.name: getattr(orbit, one.name) for one in fields(orbit)}
    return values | {"target": orbit.target.tolist(), "up": list(orbit.up)}


def changed(orbit: Orbit, values: dict) -> Orbit:
    """The orbit with other values, as JSON has them."""
    if "target" in values:
        values = values | {"target": np.array(values["target"], float)}
    if "up" in values:
        values = values | {"up": tuple(values["up"])}
    return replace(orbit, **values)


def framed(orbit: Orbit, center, radius: float, aspect: float = 1.0) -> Orbit:
    """The same direction of view, so that a ball of `radius` about `center` fills the image."""
    half_angle = 0.5 * orbit.field_of_view
    half_angle = min(half_angle, np.arctan(np.tan(half_angle) * aspect))
    reach = np.tan(half_angle) if orbit.parallel else np.sin(half_angle)
    distance = np.clip(radius / reach, CLOSEST, FARTHEST)
    return replace(orbit, target=np.asarray(center, float), distance=float(distance))


def widened(orbit: Orbit, field_of_view: float) -> Orbit:
    """Another field of view, from where the target's surroundings look as large as before."""
    ratio = np.tan(0.5 * orbit.field_of_view) / np.tan(0.5 * field_of_view)
    distance = float(np.clip(orbit.distance * ratio, CLOSEST, FARTHEST))
    return replace(orbit, field_of_view=float(field_of_view), distance=distance)


def turned(orbit: Orbit, dx: float, dy: float, height: int) -> Orbit:
    """After a drag by (dx, dy) pixels: the object follows the mouse."""
    scale = TURN_PER_HEIGHT / max(height, 1)
    pitch = np.clip(orbit.pitch + dy * scale, -STEEPEST, STEEPEST)
    yaw = (orbit.yaw - dx * scale + np.pi) % (2.0 * np.pi) - np.pi
    return replace(orbit, yaw=float(yaw), pitch=float(pitch), roll=0.0)


def turned_to(orbit: Orbit, yaw: float) -> Orbit:
    """The same camera at another angle about its target."""
    return replace(orbit, yaw=float((yaw + np.pi) % (2.0 * np.pi) - np.pi))


def panned(orbit: Orbit, dx: float, dy: float, height: int) -> Orbit:
    """After a drag by (dx, dy) pixels: the point at the target's depth follows the mouse."""
    per_pixel = 2.0 * orbit.distance * np.tan(0.5 * orbit.field_of_view) / max(height, 1)
    axes = orbit.pose[:3, :3]
    return replace(orbit, target=orbit.target + per_pixel * (dy * axes[:, 1] - dx * axes[:, 0]))


def zoomed(orbit: Orbit, factor: float, anchor=None) -> Orbit:
    """The eye `factor` times as far from `anchor`, which keeps its pixel."""
    distance = float(np.clip(orbit.distance * factor, CLOSEST, FARTHEST))
    anchor = orbit.target if anchor is None else np.asarray(anchor, float)
    target = anchor + (orbit.target - anchor) * (distance / orbit.distance)
    return replace(orbit, target=target, distance=distance)


def level_axes(yaw: float, pitch: float):
    """Right, up and backward of a camera that is not rolled, if +z is up.  [3, 3], in columns"""
    right = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    x, y = np.cos(pitch) * np.sin(yaw), -np.cos(pitch) * np.cos(yaw)
    backward = np.array([x, y, np.sin(pitch)])
    # np.cross(backward, right), which takes longer than all the rest
    up = np.array([-backward[2] * right[1], backward[2] * right[0], x * right[1] - y * right[0]])
    return np.stack([right, up, backward], axis=1)


def upright(up):
    """The smallest rotation that takes +z to a unit vector.  [3, 3]"""
    x, y, z = up
    if z < -0.999999:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + z)


def facing(orbit: Orbit, axes) -> Orbit:
    """The same target, from where the camera's axes are these  [3, 3], in columns."""
    local = upright(orbit.up).T @ axes
    right, _, backward = local.T
    pitch = np.arcsin(np.clip(backward[2], -1.0, 1.0))
    steep = np.hypot(backward[0], backward[1]) < 1e-9  # then yaw acts as the roll
    yaw = np.arctan2(right[1], right[0]) if steep else np.arctan2(backward[0], -backward[1])
    level = level_axes(yaw, pitch)
    roll = np.arctan2(right @ level[:, 1], right @ level[:, 0])
    return replace(orbit, yaw=float(yaw), pitch=float(pitch), roll=float(roll))


def looking_from(orbit: Orbit, pose, center) -> Orbit:
    """From a camera's pose [4, 4], about the point of its axis at the depth of a center [3]."""
    eye, backward = pose[:3, 3], pose[:3, 2]
    distance = float(np.clip((eye - center) @ backward, CLOSEST, FARTHEST))
    seen = replace(orbit, target=eye - distance * backward, distance=distance)
    return facing(seen, pose[:3, :3])


def with_up(orbit: Orbit, up) -> Orbit:
    """Another direction is up: the same direction of view, level, and not steeper than a drag."""
    up = tuple(float(x) for x in up)
    turned = facing(replace(orbit, up=up), orbit.pose[:3, :3])
    pitch = float(np.clip(turned.pitch, -STEEPEST, STEEPEST))
    return replace(turned, roll=0.0, pitch=pitch)


def camera_of(orbit: Orbit, width: int, height: int) -> Camera:
    """The camera for an image of width × height pixels."""
    focal = 0.5 * height / np.tan(0.5 * orbit.field_of_view)
    if orbit.parallel:
        focal /= orbit.distance
    return Camera(orbit.pose, pinhole(float(focal), width, height), orbit.parallel)


def clip_range(orbit: Orbit) -> tuple[float, float]:
    """Near and far plane, for OpenGL's depth buffer only: rays have no such planes."""
    if orbit.parallel:
        return 0.0, orbit.distance + 2.0 * BEHIND
    return 0.02 * orbit.distance, orbit.distance + 4.0


class CameraHistory:
    """The orbits at which the camera has rested."""

    def __init__(self):
        self._past: list[Orbit] = []
        self._future: list[Orbit] = []
        self._rests: Orbit | None = None  # where it rests now
        self._since = 0.0  # when it last moved

    def note(self, orbit: Orbit, moves: bool, now: float) -> None:
        """Called in every frame with the camera, and whether something still moves it."""
        if self._rests is None:
            self._rests = orbit
        if orbit is self._rests or moves:
            return
        if now - self._since > APART or not self._past:
            self._past = [*self._past, self._rests][-MOST_PAST:]
        self._future.clear()
        self._rests, self._since = orbit, now

    def back(self) -> Orbit | None:
        """The orbit before, from which `forward` leads here again; None without one."""
        return self._go(self._past, self._future)

    def forward(self) -> Orbit | None:
        """The orbit that `back` has left; None without one."""
        return self._go(self._future, self._past)

    def _go(self, there, here):
        if not there:
            return None
        here.append(self._rests)
        self._rests = there.pop()
        return self._rests
