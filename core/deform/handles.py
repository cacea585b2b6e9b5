"""Choose vertices: pins that fix an object, handles to drag it, and the neighbors of a handle.

Shapes: V vertices [V, 3], T tets [T, 4], K ids.  Positions are rest positions in model space,
z up.
"""

import numpy as np
from numpy.typing import ArrayLike

from ..geometry import components

# Least width and depth of a component's pins, in component heights: an object that is held
# at one vertex, or along a line, turns about it and never comes back.
FOOT_SIZE = 0.05


def lowest_pins(vertices: np.ndarray, tets: np.ndarray, fraction: float = 0.05) -> np.ndarray:
    """The default pins: the lowest vertices of each part.  [V] bool

    Args:
        fraction: Share of the component's height; raised where its lowest vertices are a point
            or a line.
    """
    labels = components(len(vertices), tets)
    used = np.zeros(len(vertices), bool)
    used[tets] = True
    pins = np.zeros(len(vertices), bool)
    for label in np.unique(labels[used]):
        members = np.flatnonzero(labels == label)
        pins[members[_foot(vertices[members], fraction)]] = True
    return pins


def _foot(vertices, fraction):
    """The lowest vertices of one component, as many as FOOT_SIZE needs.  [V] bool"""
    height = vertices[:, 2] - vertices[:, 2].min()
    while True:
        foot = height <= fraction * height.max() + 1e-9
        spread = np.linalg.svd(vertices[foot] - vertices[foot].mean(axis=0), compute_uv=False)
        # The second singular value is the root of the summed squares across the longest axis.
        across = spread[1] / np.sqrt(foot.sum()) if foot.sum() > 2 else 0.0
        if across >= 0.5 * FOOT_SIZE * height.max() or foot.all():
            return foot
        fraction = max(1.25 * fraction, 0.01)


def control_vertices(rest_vertices: ArrayLike, tets: np.ndarray, count: int = 24) -> np.ndarray:
    """Vertices to drag the object by, spread over it by farthest-point sampling.

    Returns:
        Vertex ids; the first one is the farthest from the middle.  [min(count, V)]
    """
    used = np.unique(tets)
    points = np.asarray(rest_vertices, np.float64)[used]
    nearest = np.full(len(points), np.inf)  # squared distance to the chosen ones
    chosen = []
    candidate = int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())
    while len(chosen) < min(count, len(points)):
        chosen.append(candidate)
        nearest = np.minimum(nearest, ((points - points[candidate]) ** 2).sum(axis=1))
        candidate = int(nearest.argmax())
    return used[chosen]


def vertices_within(
    rest_vertices: np.ndarray, center: int | ArrayLike, radius: float
) -> np.ndarray:
    """The vertices no farther than a radius from a vertex or a point, at rest.  [K]

    Args:
        center: A vertex id, or a point [3].
    """
    return np.flatnonzero(_squared(rest_vertices, center) <= radius * radius)


def falloff(
    rest_vertices: np.ndarray, center: int | ArrayLike, ids: np.ndarray, radius: float
) -> np.ndarray:
    """The share of a pull at a center that each of these gets: (1 − (d/radius)²)².  [K]

    It is 1 at the center and falls to 0 at the radius with slope 0; a kink would be visible.

    Args:
        center: A vertex id, or a point [3].
        ids: Vertices within the radius at rest.  [K]
        radius: With 0, only a vertex at the center gets a share.
    """
    squared = _squared(rest_vertices, center)[ids]
    return (1.0 - np.minimum(squared / max(radius * radius, 1e-30), 1.0)) ** 2


def _squared(rest_vertices, center):
    """Squared distances of all vertices from a center.  [V]"""
    center = rest_vertices[center] if np.ndim(center) == 0 else np.asarray(center)
    return ((rest_vertices - center) ** 2).sum(axis=1)
