"""The gizmo: arrows, rings or boxes at what is selected, by which it is moved, turned or scaled.

Its parts are lines of pixels, as `project` of the picture's camera has them.  Panels draw the
lines, and a press takes the nearest one: what shows is what is taken, through any lens and
also while no frame was drawn since the mouse moved.  Pixels are the image's.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from ..camera import pixels_per_unit, project, within
from ..document import HEAD
from ..settings import OF_BONES
from .constraints import MOVE, SCALE, TURN

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
        starts, ways = self.line[:-1], np.diff(self.line, axis=0)
        offsets = pixel - starts
        lengths = np.maximum((ways**2).sum(axis=1), 1e-12)
        share = np.clip((offsets * ways).sum(axis=1) / lengths, 0.0, 1.0)
        return float(np.linalg.norm(offsets - share[:, None] * ways, axis=1).min())


def parts_of(gizmo: Gizmo, camera, ratio: float) -> list[Part]:
    """What shows of a gizmo.  `ratio`: pixels per point."""
    (center,), (t,) = project(camera, gizmo.pivot[None])
    depth = (gizmo.pivot - camera.position) @ camera.forward
    if not np.isfinite(center).all() or t <= 0.0:
        return []
    length = LENGTH * ratio / float(pixels_per_unit(camera, depth))
    view = camera.position - gizmo.pivot
    toward = -camera.forward if camera.parallel else view / np.linalg.norm(view)
    make = partial(_rings if gizmo.kind == TURN else _arrows, gizmo, length, toward)
    found = []
    for axis, across, points in make():
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


# -- what has one ------------------------------------------------------------------------------


def gizmo_of(scene) -> Gizmo | None:
    """The gizmo of what is selected, or of the chosen bone or joint; None without one."""
    settings = scene.settings
    if settings.gizmo == "off" or settings.tool not in ("grab", *OF_BONES):
        return None
    if settings.tool in OF_BONES:
        return _of_rig(scene) if settings.show_bones else None
    ids = scene.handles.takeable if settings.show_handles else []
    if not ids:
        return None
    axes = own_axes(scene) if settings.own_axes else np.eye(3)
    return Gizmo(settings.gizmo, scene.handles.at(ids).mean(axis=0), axes)


def _of_rig(scene):
    """A joint moves; a bone turns about its head, or its tip moves, or a root does."""
    joint = chosen_joint(scene)
    if joint is None:
        return None
    is_own = scene.settings.own_axes and joint.bone >= 0
    axes = own_axes(scene, joint.bone) if is_own else np.eye(3)
    if scene.settings.tool == "joints":
        return Gizmo(MOVE, joint.place, axes)
    if joint.bone < 0:
        return None
    head, tail = scene.posing.ends[joint.bone]
    if scene.settings.gizmo == MOVE:
        return Gizmo(MOVE, head if is_root(scene, joint) else tail, axes)
    return Gizmo(TURN, head, axes)


def is_root(scene, joint) -> bool:
    """Whether a joint is the head of a bone that hangs on none: it can be moved in a pose."""
    return joint.bone >= 0 and joint.end == HEAD and scene.rigging.skeleton.parents[joint.bone] < 0


def chosen_joint(scene):
    """The joint that is chosen, or None."""
    rigging = scene.rigging
    return next((one for one in rigging.joints if one.name == rigging.selected), None)


def own_axes(scene, bone: int | None = None):
    """A bone's axes; without one, what has become of model space's where the selection is.

    [3, 3], in columns
    """
    if bone is not None:
        return scene.posing.axes(bone)
    handles, rest = scene.handles, scene.field.mesh.rest_vertices
    held = handles.takeable if handles.grabbed is None else handles.grabbed.handles
    if not held:
        return np.eye(3)
    ids = np.unique(np.concatenate([handles.corners(one) for one in held]))
    if len(ids) < 4:  # single vertices: freed pins
        ids = handles.patch(held[0], scene.grab_radius)
    return best_rotation(rest[ids], scene.positions[ids])


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
