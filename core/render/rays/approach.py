"""Rays of a far camera begin close to the mesh: float32 would lose their t to the distance.

A t is kept to 6e-8 of itself, and a face is found within 4e-6, so an object is drawn well from up
to some ten times its size away.  From farther, rays are computed in float64 and begin at the ball
around the mesh; what they skip is added to their depth.
"""

import numpy as np

from .marching import Rays

FAR = 8.0  # radii of the ball around the mesh, from its center
GAP = 0.05  # of a radius: rays begin that far before the ball


def ball_around(vertices):
    """Center and radius of a ball around positions [V, 3]; None if one of them is infinite."""
    low, high = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
    if not np.isfinite([low, high]).all():
        return None
    return 0.5 * (low + high), 0.5 * np.linalg.norm(high - low)


def is_far(origin, ball) -> bool:
    """Whether rays from there begin at the ball."""
    return ball is not None and np.linalg.norm(np.asarray(origin) - ball[0]) > FAR * ball[1]


def begin_at_ball(rays: Rays, origins, directions, ball):
    """Give rays their origins [R, 3] and unit directions; those from afar begin at the ball.

    Returns:
        The t of the beginnings on the given rays, float32 [R].
    """
    origins, directions = np.asarray(origins, float), np.asarray(directions, float)
    skipped = np.zeros(len(origins))
    if ball is not None:
        center, radius = ball
        along = ((center - origins) * directions).sum(axis=1)
        far = np.linalg.norm(origins - center, axis=1) > FAR * radius
        skipped = np.where(far, np.maximum(along - (1.0 + GAP) * radius, 0.0), 0.0)
        origins = origins + skipped[:, None] * directions
    rays.origins.assign(np.ascontiguousarray(origins, np.float32))
    rays.directions.assign(np.ascontiguousarray(directions, np.float32))
    return skipped.astype(np.float32)
