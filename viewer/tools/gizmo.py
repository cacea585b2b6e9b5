"""The gizmo: arrows, rings or boxes at what is selected, by which it is moved, turned or scaled.

Its parts are lines of pixels, as `project` of the picture's camera has them.  Panels draw the
lines, and a press takes the nearest one: what shows is what is taken, through any lens and
also while no frame was drawn since the mouse moved.  Pixels are the image's.
"""

from dataclasses import dataclass

import numpy as np

from ..camera import away_from_lines, pixels_per_unit, project, within
from .drags import SCALE, TURN

LENGTH = 80.0  # points, of an arrow across the view
GAP = 0.22  # of the length, from the pivot to where an arrow begins: the red point is there
SQUARE = 0.42, 0.62  # of the length: where a plane's square begins and ends
RINGS = 1.0, 1.2  # of the length: radius of the rings about the axes, and of the one in the view
SHORTEST = 0.25  # of the length: an arrow that seems shorter points at the eye, and isn't shown
REACH = 7.0  # points from a line, where the mouse has it
PIECES = 64  # of a ring
RING_STEP = 2.0 * np.pi / PIECES  # radians between two of its points


@dataclass(frozen=True)
class Gizmo:
    """What a gizmo does, and where it is."""

    kind: str  # MOVE, TURN or SCALE
    pivot: np.ndarray  # [3]
    axes: np.ndarray  # in columns  [3, 3]


@dataclass(frozen=True, eq=False)
class Part:
    """What of a gizmo the mouse can take."""

    axis: int | None  # None: any, by the ring that faces the eye
    across: bool  # whether it is the square, of the plane across the axis
    line: np.ndarray  # pixels  [N, 2]

    @property
    def name(self) -> str:
        """As "x" for an axis, "yz" for a plane, "view" for any."""
        if self.axis is None:
            return "view"
        return "xyz".replace("xyz"[self.axis], "") if self.across else "xyz"[self.axis]

    @property
    def grip(self) -> np.ndarray:
        """A pixel of it.  [2]"""
        return self.line[:-1].mean(axis=0) if self.across else self.line[len(self.line) // 2]

    def away(self, pixel) -> float:
        """How far a pixel is from it; 0 inside a square [pixels]."""
        if self.across and within(np.array([pixel]), self.line)[0]:
            return 0.0
        return float(away_from_lines(pixel, self.line[:-1], self.line[1:]).min())


def parts_of(gizmo: Gizmo, camera, ratio: float) -> list[Part]:
    """What shows of a gizmo.  `ratio`: pixels per point."""
    (center,), (t,) = project(camera, gizmo.pivot[None])
    depth = (gizmo.pivot - camera.position) @ camera.forward
    if not np.isfinite(center).all() or t <= 0.0:
        return []
    length = LENGTH * ratio / float(pixels_per_unit(camera, depth))
    view = camera.position - gizmo.pivot
    toward = -camera.forward if camera.parallel else view / np.linalg.norm(view)
    make = _rings if gizmo.kind == TURN else _arrows
    found = []
    for axis, across, points in make(gizmo, length, toward):
        pixels, _ = project(camera, gizmo.pivot + points)
        if len(pixels) > 1 and np.isfinite(pixels).all():
            found.append(Part(axis, across, pixels))
    return found


def _arrows(gizmo, length, toward):
    """Axis, whether it is a plane, and offsets of the points of each part."""
    for axis in range(3):
        along = gizmo.axes[:, axis]
        if np.linalg.norm(np.cross(along, toward)) > SHORTEST:
            yield axis, False, length * np.outer([GAP, 0.6, 1.0], along)
        if abs(along @ toward) > SHORTEST:
            u, v = np.delete(gizmo.axes, axis, axis=1).T
            near, far = SQUARE
            corners = [(near, near), (far, near), (far, far), (near, far), (near, near)]
            yield axis, True, length * (np.array(corners) @ [u, v])
    if gizmo.kind == SCALE:
        yield None, False, RINGS[1] * length * _circle(toward)


def _rings(gizmo, length, toward):
    """As `_arrows`; of the rings about axes, the half that is nearer to the eye."""
    for axis in range(3):
        ring = _circle(gizmo.axes[:, axis])
        near = ring @ toward >= -0.05
        if not near.all():  # the half begins where it comes to the front
            (first, *_) = np.flatnonzero(near[:-1] & ~np.roll(near[:-1], 1))
            ring = np.roll(ring[:-1], -first, axis=0)[: int(near[:-1].sum())]
        yield axis, False, RINGS[0] * length * ring
    yield None, False, RINGS[1] * length * _circle(toward)


def _circle(axis):
    """Points around an axis [3], the last one where the first is.  [PIECES + 1, 3]"""
    u = np.cross(axis, np.eye(3)[abs(axis).argmin()])
    u /= np.linalg.norm(u)
    angle = np.linspace(0.0, 2.0 * np.pi, PIECES + 1)[:, None]
    return np.cos(angle) * u + np.sin(angle) * np.cross(axis, u)


def part_at(parts: list[Part], pixel, ratio: float) -> Part | None:
    """The part under a pixel, the nearest one."""
    away = [part.away(pixel) for part in parts]
    return parts[int(np.argmin(away))] if away and min(away) <= REACH * ratio else None


def best_rotation(rest, now):
    """The rotation that takes points [K, 3] nearest to where they are now [K, 3], by squares.

    The identity where they lie on a line, so that it isn't determined.  [3, 3]
    """
    rest, now = np.asarray(rest, float), np.asarray(now, float)
    covariance = (now - now.mean(axis=0)).T @ (rest - rest.mean(axis=0))
    left, sizes, right = np.linalg.svd(covariance)
    if not sizes[1] > 1e-9 * max(sizes[0], 1e-30):
        return np.eye(3)
    return left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
