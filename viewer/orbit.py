"""The orbit camera: a target, a distance and two angles; every gesture returns a new one.

Pixels are the image's (x to the right, y down, origin at the top left corner), angles are
radians.  Yaw 0 looks along +y, as model space has z up; pitch is the eye's height above
the target's horizon.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ..core.render import Camera, look_at, pinhole

STEEPEST = np.radians(89.0)  # at 90° `up` and the view direction coincide
CLOSEST, FARTHEST = 0.02, 50.0  # distance from the target, in model units
TURN_PER_HEIGHT = np.pi  # a drag over the height of the image turns by half a turn


@dataclass(frozen=True)
class Orbit:
    """The camera's position and direction."""

    target: np.ndarray = field(default_factory=lambda: np.full(3, 0.5))  # looked at, turned about
    distance: float = 2.0  # from the eye to the target
    yaw: float = 0.0  # about +z
    pitch: float = 0.0  # above the horizon
    field_of_view: float = float(np.radians(35.0))  # vertical, of the whole image


def framing(orbit: Orbit, center, radius: float, aspect: float = 1.0) -> Orbit:
    """The same direction of view, so that a ball of `radius` about `center` fills the image."""
    half_angle = 0.5 * orbit.field_of_view
    half_angle = min(half_angle, np.arctan(np.tan(half_angle) * aspect))
    distance = np.clip(radius / np.sin(half_angle), CLOSEST, FARTHEST)
    return replace(orbit, target=np.asarray(center, float), distance=float(distance))


def turned(orbit: Orbit, dx: float, dy: float, height: int) -> Orbit:
    """After a drag by (dx, dy) pixels: the object follows the mouse."""
    scale = TURN_PER_HEIGHT / max(height, 1)
    pitch = np.clip(orbit.pitch + dy * scale, -STEEPEST, STEEPEST)
    yaw = (orbit.yaw - dx * scale + np.pi) % (2.0 * np.pi) - np.pi
    return replace(orbit, yaw=float(yaw), pitch=float(pitch))


def panned(orbit: Orbit, dx: float, dy: float, height: int) -> Orbit:
    """After a drag by (dx, dy) pixels: the point at the target's depth follows the mouse."""
    per_pixel = 2.0 * orbit.distance * np.tan(0.5 * orbit.field_of_view) / max(height, 1)
    axes = pose(orbit)[:3, :3]
    return replace(orbit, target=orbit.target + per_pixel * (dy * axes[:, 1] - dx * axes[:, 0]))


def zoomed(orbit: Orbit, factor: float, anchor=None) -> Orbit:
    """The eye `factor` times as far from `anchor`, which keeps its pixel."""
    distance = float(np.clip(orbit.distance * factor, CLOSEST, FARTHEST))
    anchor = orbit.target if anchor is None else np.asarray(anchor, float)
    target = anchor + (orbit.target - anchor) * (distance / orbit.distance)
    return replace(orbit, target=target, distance=distance)


def pose(orbit: Orbit):
    """Camera to world.  [4, 4]"""
    horizontal = np.cos(orbit.pitch)
    x, y, z = horizontal * np.sin(orbit.yaw), -horizontal * np.cos(orbit.yaw), np.sin(orbit.pitch)
    return look_at(orbit.target + orbit.distance * np.array([x, y, z]), orbit.target)


def camera(orbit: Orbit, width: int, height: int) -> Camera:
    """The pinhole camera for an image of width × height pixels."""
    focal = 0.5 * height / np.tan(0.5 * orbit.field_of_view)
    return Camera(pose(orbit), pinhole(float(focal), width, height))


def clip_range(orbit: Orbit) -> tuple[float, float]:
    """Near and far plane, for OpenGL's depth buffer only: rays have no such planes."""
    return 0.02 * orbit.distance, orbit.distance + 4.0
