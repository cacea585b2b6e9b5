"""Move the origins of rays so that float32 is precise enough: off edges and faces, near the mesh.

If a ray runs along an edge or within a face, rounding decides at every face whether it meets the
tets on both sides or none, and the walk can leave the mesh.  Lattices have such rays in every view
along an axis or within a plane of two axes.  So rays parallel to such a plane are moved by ASIDE,
and meet the tets on one side.

A t has a relative error of 6e-8, and the walk finds a face within 4e-6.  So an object is drawn well
up to a distance of some ten times its size.  From farther away, rays are computed in float64 and
begin at the ball around the mesh; the skipped distance is added to their depth.
"""

from dataclasses import replace

import numpy as np

from ...definition.image import ASIDE
from .camera import Camera

PARALLEL = 1e-7  # a component of a unit direction
FAR = 8.0  # radii of the ball around the mesh, from its center
GAP = 0.05  # of a radius: rays begin that far before the ball


def ball_around(vertices, origin=None):
    """Center and radius of a ball around positions [V, 3], at which rays begin.

    None if a position is infinite, or if an origin [3] of all rays is given that isn't far.
    """
    low, high = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
    if not np.isfinite([low, high]).all():
        return None
    center, radius = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low)
    if origin is not None and np.linalg.norm(np.asarray(origin) - center) <= FAR * radius:
        return None
    return center, radius


def is_parallel(directions):
    """Whether unit directions [..., 3] are parallel to a plane of two axes."""
    return (np.abs(directions) < PARALLEL).any(axis=-1)


def moved_aside(camera: Camera) -> Camera:
    """A camera whose parallel rays are moved, if they may be in faces."""
    if not camera.parallel or not is_parallel(camera.forward):
        return camera
    pose = np.array(camera.camera_to_world, float)
    pose[:3, 3] += ASIDE
    return replace(camera, camera_to_world=pose)


def begin_at_ball(origins, directions, ball):
    """Begin rays beside faces, and not far from the ball.

    Args:
        origins, directions: [R, 3]; the directions have the length 1.

    Returns:
        Origins and directions [R, 3] float32, and the t of the beginnings on the given rays,
        float32 [R].
    """
    origins, directions = np.asarray(origins, float), np.asarray(directions, float)
    origins = origins + np.where(is_parallel(directions)[:, None], ASIDE, 0.0)
    skipped = np.zeros(len(origins))
    if ball is not None:
        center, radius = ball
        along = ((center - origins) * directions).sum(axis=1)
        far = np.linalg.norm(origins - center, axis=1) > FAR * radius
        skipped = np.where(far, np.maximum(along - (1.0 + GAP) * radius, 0.0), 0.0)
        origins = origins + skipped[:, None] * directions
    return tuple(np.ascontiguousarray(a, np.float32) for a in (origins, directions, skipped))
