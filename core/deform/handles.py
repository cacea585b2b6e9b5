"""Which vertices hold an object, which ones a user can drag, and what a drag takes along.

Shapes: V vertices, T tets.  Positions are rest positions in model space, z up.
"""

import numpy as np

from ..geometry import components

# The pins of a component must be at least this wide and deep, in component heights: an
# object that stands on one vertex, or on a line, turns about it and never comes back.
FOOT_SIZE = 0.05


def lowest_pins(vertices, tets, fraction=0.05):
    """The lowest part of each connected component, which holds it by default.  [V] bool

    Args:
        vertices: [V, 3]
        tets: [T, 4]
        fraction: Of the component's height; raised where what lies below is a point or
            a line.
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
    """The lowest vertices of one component, enough of them to stand on.  [V] bool"""
    height = vertices[:, 2] - vertices[:, 2].min()
    while True:
        foot = height <= fraction * height.max() + 1e-9
        spread = np.linalg.svd(vertices[foot] - vertices[foot].mean(axis=0), compute_uv=False)
        # The second singular value is the root of the summed squares across the longest axis.
        across = spread[1] / np.sqrt(foot.sum()) if foot.sum() > 2 else 0.0
        if across >= 0.5 * FOOT_SIZE * height.max() or foot.all():
            return foot
        fraction = max(1.25 * fraction, 0.01)


def control_vertices(rest_vertices, tets, count=24):
    """Vertices to drag the object by, spread evenly over it: farthest-point sampling.

    Args:
        rest_vertices: [V, 3]
        tets: [T, 4]
        count: How many; fewer if the mesh has fewer vertices.

    Returns:
        Vertex ids; the first one is the farthest from the middle.  [min(count, V)]
    """
    used = np.unique(tets)
    points = np.asarray(rest_vertices, np.float64)[used]
    nearest = np.full(len(points), np.inf)  # squared distance to what was chosen
    chosen = []
    candidate = int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())
    while len(chosen) < min(count, len(points)):
        chosen.append(candidate)
        nearest = np.minimum(nearest, ((points - points[candidate]) ** 2).sum(axis=1))
        candidate = int(nearest.argmax())
    return used[chosen]


def vertices_within(rest_vertices, vertex, radius):
    """The vertices no farther than a radius from one vertex, itself included, at rest.  [K]"""
    squared = ((rest_vertices - rest_vertices[vertex]) ** 2).sum(axis=1)
    return np.flatnonzero(squared <= radius * radius)


def falloff(rest_vertices, vertex, ids, radius):
    """How much of a pull at one vertex each of these gets: (1 − (d/radius)²)².  [K]

    It is 1 at the vertex, and goes to 0 at the radius without a kink, which would be seen.

    Args:
        ids: No farther from it than the radius, at rest.  [K]
        radius: At 0, only the vertex itself gets something.
    """
    squared = ((rest_vertices[ids] - rest_vertices[vertex]) ** 2).sum(axis=1)
    return (1.0 - np.minimum(squared / max(radius * radius, 1e-30), 1.0)) ** 2
