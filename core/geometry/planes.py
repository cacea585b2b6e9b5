"""Planes among points: RANSAC, then least squares.

Shapes: n points.
"""

from dataclasses import dataclass

import numpy as np

TRIES = 1500
LOOKED_AT = 4000  # points, of which the tries are judged
FEWEST_POINTS = 40  # that planes are sought among


@dataclass(frozen=True)
class Plane:
    """Points x with normal · x = offset."""

    normal: np.ndarray  # [3] a unit vector
    offset: float

    def height(self, points):
        """How far points lie in front of it.  [..., 3] -> [...]"""
        return points @ self.normal - self.offset

    def turned(self) -> "Plane":
        """The same plane, seen from its other side."""
        return Plane(-self.normal, -self.offset)


def heaviest_plane(points, weights, thickness, rng) -> Plane | None:
    """The plane with the most weight near it; None of too few points.

    Args:
        points: [n, 3]
        weights: [n]
        thickness: Points that are as far from a plane still belong to it.
        rng: A generator of NumPy, for the tries.
    """
    if len(points) < FEWEST_POINTS or weights.sum() <= 0.0:
        return None
    corners = points[rng.choice(len(points), (TRIES, 3), p=weights / weights.sum())]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    sane = lengths > 1e-12
    if not sane.any():
        return None
    normals, origins = normals[sane] / lengths[sane, None], corners[sane, 0]
    offsets = (normals * origins).sum(axis=1)
    few = rng.choice(len(points), min(len(points), LOOKED_AT), replace=False)
    near = abs(points[few] @ normals.T - offsets) < thickness
    best = np.argmax(weights[few] @ near)
    normal, offset = normals[best], offsets[best]
    for _ in range(5):
        inside = abs(points @ normal - offset) < thickness
        if inside.sum() < 3:
            return None
        w = weights[inside] / weights[inside].sum()
        mean = w @ points[inside]
        away = points[inside] - mean
        axes = np.linalg.eigh((w[:, None] * away).T @ away)[1]
        normal = axes[:, 0] * np.sign(axes[:, 0] @ normal or 1.0)
        offset = normal @ mean
    return Plane(normal, float(offset))
