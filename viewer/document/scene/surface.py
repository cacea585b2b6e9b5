"""Points on the object's surface, as seen from all around.

A trained mesh also has tets around the object and specks in empty space.  A user wants to
frame, hold and grab what can be seen, which is the opaque pixels of a few small images.
"""

import numpy as np

from ....core.geometry import components
from ....core.render import camera_rays
from ...camera import Orbit, camera_of, framed
from .points import squared_distances

VIEWS = (*((np.radians(60.0 * k), np.radians(15.0)) for k in range(6)), (0.0, 1.4), (0.0, -1.4))
VIEW_SIZE = 64  # pixels
SPECKS = 0.5  # percent of the points that the bounds leave out at each side
MAX_POINTS = 4000
STEP = 0.1  # of the object's radius, between the depths of two pixels of one surface
FOOT, WIDE = 0.02, 0.33  # of the height, and of the width: what a foot is, how wide it has to be
SPECK = 0.02  # of the vertices: components smaller than that have no handles


def visible_points(renderer, vertices):
    """At most MAX_POINTS points on the opaque surface; the vertices if nothing is opaque.

    The Renderer has the pose of the vertices [V, 3].

    Returns:
        Points, [N, 3] float64, and which of them are steady, [N] bool: a pixel on an outline
        mixes the depths of what is before and behind, and lies in the air between them.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    radius = 0.5 * float(np.linalg.norm(high - low))
    points, steady = [], []
    for yaw, pitch in VIEWS:
        orbit = framed(Orbit(yaw=yaw, pitch=pitch), 0.5 * (low + high), radius)
        camera = camera_of(orbit, VIEW_SIZE, VIEW_SIZE)
        depth = renderer.render(camera).depth_array()
        t = depth.ravel()
        hit = np.isfinite(t)
        steady.append((_largest_step(depth) <= STEP * radius).ravel()[hit])
        _, directions = camera_rays(camera)
        points.append(camera.position + t[hit, None] * directions[hit])
    points, steady = np.concatenate(points), np.concatenate(steady)
    if not len(points):
        return np.asarray(vertices, float), np.ones(len(vertices), bool)
    every = -(-len(points) // MAX_POINTS)
    return points[::every], steady[::every]


def _largest_step(depth):
    """From each pixel to its four neighbors, where both are on the object.  [H, W]"""
    wider = np.pad(depth, 1, mode="edge")
    near = wider[2:, 1:-1], wider[:-2, 1:-1], wider[1:-1, 2:], wider[1:-1, :-2]
    with np.errstate(invalid="ignore"):
        steps = abs(np.array(near) - depth)
    return np.nan_to_num(steps, nan=0.0, posinf=0.0).max(axis=0).astype(float)


def bounds(points):
    """Lowest and highest corner of the box around the points, without specks.  [3], [3]"""
    return tuple(np.percentile(points, [SPECKS, 100.0 - SPECKS], axis=0))


def stands(points) -> bool:
    """Whether an object with these points [N, 3] looks as if it stood: its foot is wide.

    The foot, the lowest FOOT of its height, is WIDE of all of it at least, and below its middle.
    """
    points = np.asarray(points, float)
    (low, high), middle = bounds(points), np.median(points, axis=0)[:2]
    foot = points[points[:, 2] <= low[2] + FOOT * (high - low)[2], :2]
    if len(foot) < 3:
        return False
    left, right = foot.min(axis=0), foot.max(axis=0)
    wide = (right - left >= WIDE * (high - low)[:2]).all()
    return bool(wide and (left <= middle).all() and (middle <= right).all())


def nearest_vertices(points, vertices):
    """The id of the vertex [V, 3] that is nearest to each of the points [N, 3].  [N]"""
    points, vertices = np.asarray(points, float), np.asarray(vertices, float)
    return np.concatenate([some.argmin(axis=1) for some in squared_distances(points, vertices)])


def of_the_object(rest, tets):
    """Whether each vertex belongs to more than a speck.  [V] bool"""
    labels = components(len(rest), tets)
    return np.bincount(labels)[labels] >= SPECK * len(rest)
