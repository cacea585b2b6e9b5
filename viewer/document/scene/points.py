"""Control points: points of the visible surface, each fixed in a tet, by which one drags.

A point's weights say where in its tet it is; it goes where the tet goes.  Shapes: V vertices,
T tets, C control points.
"""

from dataclasses import dataclass

import numpy as np

from ....core.geometry import components

MOST_POINTS = 100  # that are placed at the start
SPACING = 0.12  # of the object's size, between two of them
SPECK = 0.02  # of the surface's points: what is apart from the others and smaller is no object
SPARSE = 0.3  # of the points: if the largest cluster has fewer, they are too far apart
BLOCK = 1_000_000  # distances at once
FLAT = 1e-12  # of the longest side cubed: a tet of less volume holds no point


@dataclass(frozen=True)
class ControlPoints:
    """Points in tets."""

    corners: np.ndarray  # vertex ids of each point's tet  [C, 4]
    weights: np.ndarray  # barycentric, float64  [C, 4]

    @staticmethod
    def of_rows(rows: list) -> "ControlPoints":
        """Those of rows of four vertex ids and four weights."""
        rows = np.array(rows, float).reshape(-1, 8)
        return ControlPoints(rows[:, :4].astype(int), rows[:, 4:])

    def rows(self) -> list:
        """As lists of four vertex ids and four weights."""
        return [
            [*ids, *weights]
            for ids, weights in zip(self.corners.tolist(), self.weights.tolist(), strict=True)
        ]

    def __len__(self):
        return len(self.corners)

    def at(self, vertices):
        """Where they are, for these vertices [V, 3].  [C, 3] float64"""
        return np.einsum("ck,ckx->cx", self.weights, np.asarray(vertices, float)[self.corners])

    def share(self, marked):
        """The share of each point that belongs to marked vertices [V] bool.  [C]"""
        return (self.weights * marked[self.corners]).sum(axis=1)

    def without_last(self) -> "ControlPoints":
        return ControlPoints(self.corners[:-1], self.weights[:-1])

    def joined(self, more: "ControlPoints") -> "ControlPoints":
        """These, and more behind them."""
        corners = np.concatenate([self.corners, more.corners])
        return ControlPoints(corners, np.concatenate([self.weights, more.weights]))


def squared_distances(points, others):
    """Those from some points after another [N, 3] to the others [M, 3], as blocks [some, M].

    As a product of matrices, so each is off by 10⁻¹⁵ of the squared distance from the origin.
    """
    squares = (others**2).sum(axis=1)
    for some in np.array_split(points, max(1, len(points) * len(others) // BLOCK)):
        yield (some**2).sum(axis=1)[:, None] - 2.0 * (some @ others.T) + squares


def spread(points, spacing: float, count: int):
    """Ids of points [N, 3] that are at least `spacing` apart, by farthest-point sampling.

    The first one is the farthest from their middle.  [at most count]
    """
    points = np.asarray(points, float)
    apart = np.full(len(points), np.inf)  # squared distance to the chosen ones
    chosen = []
    candidate = int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())
    while len(chosen) < min(count, len(points)) and apart[candidate] >= spacing**2:
        chosen.append(candidate)
        apart = np.minimum(apart, ((points - points[candidate]) ** 2).sum(axis=1))
        candidate = int(apart.argmax())
    return np.array(chosen)


def located(points, vertices, tets) -> ControlPoints:
    """The tet in which each point [N, 3] is, or the one that it is least outside of."""
    corners = np.asarray(vertices, float)[tets]
    origins, sides = corners[:, 0], corners[:, 1:] - corners[:, :1]  # [T, 3], [T, 3, 3]
    # Rows that measure an offset from the origin in shares of the three sides (Cramer's rule).
    rows = np.cross(sides[:, [1, 2, 0]], sides[:, [2, 0, 1]])
    volumes = (sides[:, 0] * rows[:, 0]).sum(axis=1)
    flat = abs(volumes) <= FLAT * float(np.ptp(corners, axis=(0, 1)).max()) ** 3
    rows = rows / np.where(flat, 1.0, volumes)[:, None, None]
    points = np.asarray(points, float)
    starts = (rows @ origins[:, :, None])[:, :, 0]
    ids, weights = [np.zeros(0, int)], [np.zeros((0, 4))]
    for some in np.array_split(points, max(1, 3 * len(points) * len(tets) // BLOCK)):
        along = (rows.reshape(-1, 3) @ some.T).reshape(-1, 3, len(some)) - starts[:, :, None]
        shares = np.concatenate([1.0 - along.sum(axis=1, keepdims=True), along], axis=1)
        best = np.where(flat[:, None], -np.inf, shares.min(axis=1)).argmax(axis=0)
        inside = np.maximum(shares[best, :, np.arange(len(some))], 0.0)
        ids.append(best)
        weights.append(inside / inside.sum(axis=1, keepdims=True))
    return ControlPoints(np.asarray(tets)[np.concatenate(ids)], np.concatenate(weights))


def of_large_clusters(points, radius: float):
    """Which points [N, 3] belong to a cluster of some size.  [N] bool

    Points nearer than the radius are of one cluster.  A small one is a speck in the air, which a
    white background hides in white.
    """
    points = np.asarray(points, float)
    near = np.concatenate([some < radius**2 for some in squared_distances(points, points)])
    clusters = components(len(points), np.argwhere(near))
    sizes = np.bincount(clusters)[clusters]
    if sizes.max() < SPARSE * len(points):  # the points are too few to tell
        return np.ones(len(points), bool)
    return sizes >= SPECK * len(points)


def placed(surface, rest_vertices, tets, size: float) -> ControlPoints:
    """Control points that are spread over points of the surface [N, 3].  `size`: the object's."""
    surface = np.asarray(surface)[of_large_clusters(surface, 0.5 * SPACING * size)]
    chosen = spread(surface, SPACING * size, MOST_POINTS)
    return located(surface[chosen], rest_vertices, tets)
