"""Flat parts of a field's matter, such as a floor, a wall, or the sides of a box.

A flat part is a plane, and the outline within which matter lies on it, as cells of a grid in the
plane.  Matter is a shell about as thick as a few sub-tets.

    edge      the mean edge of a sub-tet, the unit of every length below
    normal    [3] of a plane, to either side

Shapes: N occupied sub-tets, n points drawn from those that are more than fog.
"""

from dataclasses import dataclass

import numpy as np

from ...geometry import Plane
from .subtet_graph import SubtetGraph

FOG = 0.1  # optical depth across a sub-tet, without more it is fog
POINTS_MAX = 24_000  # drawn of the matter
SMOOTH, AROUND = 1.0, 2.0  # of opacity; of its slopes [edges]
FEWEST = 50  # points
TRIES, FLATS_MAX = 400, 12
THICKNESS = 1.25  # of a flat part's shell, to each side [edges]
PARALLEL = 0.8  # cosine between a point's normal and the plane's
CELL = 2.5  # of the grid in a plane [edges]
USUAL, FEW = 80.0, 0.3  # percentile of the points in a cell; share of that, that covers it
PURE = 0.5  # of the points around a cell that lie on the plane
SHARE = 0.02  # of all points that a flat part has at least


@dataclass(frozen=True)
class Flat:
    """A flat part.

    Attributes:
        plane: Its plane; to which side its normal points has no meaning.
        axes: Two directions in the plane.  [2, 3]
        origin, cells: The grid: where it begins along the axes [2], and which cells the part
            covers [rows, columns] bool.
        cell: The edge of a cell [model units].
        share: Of the points that lie on it.
    """

    plane: Plane
    axes: np.ndarray
    origin: np.ndarray
    cells: np.ndarray
    cell: float
    share: float

    @property
    def area(self) -> float:
        """Of its outline."""
        return float(self.cells.sum()) * self.cell**2

    def covers(self, points: np.ndarray) -> np.ndarray:
        """Whether points lie over or under its outline.  [n, 3] -> [n] bool"""
        index = np.floor((points @ self.axes.T - self.origin) / self.cell).astype(int)
        inside = ((index >= 0) & (index < self.cells.shape)).all(axis=1)
        row, column = np.clip(index, 0, np.array(self.cells.shape) - 1).T
        return inside & self.cells[row, column]

    def corners(self) -> np.ndarray:
        """The middles of its cells, in space.  [cells, 3]"""
        places = self.origin + self.cell * (np.argwhere(self.cells) + 0.5)
        return places @ self.axes + self.plane.offset * self.plane.normal


def flats_of(matter: SubtetGraph, seed: int = 0) -> list[Flat]:
    """The flat parts, the one with the most matter first.

    Another seed draws other points, and may find others of those that are hardly flat.
    """
    rng = np.random.default_rng(seed)
    opacity = 1.0 - np.exp(-matter.depths)
    total = float(opacity.sum())
    if total <= FEWEST:
        return []
    count = int(min(total, POINTS_MAX))
    ids = np.unique(rng.choice(len(opacity), count, p=opacity / total))
    points = matter.middles[ids]
    normals = normals_of(matter, points)
    spacing = np.cbrt(max(1.0, total / len(ids)))  # of those drawn [edges]
    left, found = np.ones(len(points), bool), []
    for _ in range(FLATS_MAX):
        flat = _flattest(points, normals, left, matter.edge, spacing, rng)
        if flat is None:
            break
        found.append(flat)
        heights = abs(flat.plane.height(points)) < 2.0 * THICKNESS * matter.edge
        left &= ~(heights & flat.covers(points))
    return found


def normals_of(matter: SubtetGraph, points: np.ndarray) -> np.ndarray:
    """The normal of the surfaces near points [n, 3], by the structure tensor of opacity.  [n, 3]

    With ρ, the matter in cubes of an edge, smoothed, that is the first eigenvector of the means of
    ∇ρ ∇ρᵀ nearby.  Both faces of a shell agree about it.
    """
    from scipy.ndimage import gaussian_filter

    low = matter.middles.min(axis=0) - 4.0 * matter.edge

    def cubes(places):
        return np.floor((places - low) / matter.edge).astype(int)

    index = cubes(matter.middles)
    density = np.zeros(index.max(axis=0) + 5)
    weights = (1.0 - np.exp(-matter.depths)) * matter.volumes / matter.edge**3
    np.add.at(density, tuple(index.T), weights)
    slopes = np.gradient(gaussian_filter(density, SMOOTH))
    tensors = np.empty((len(points), 3, 3))
    own = tuple(cubes(points).T)
    for i in range(3):
        for j in range(i, 3):
            tensors[:, i, j] = gaussian_filter(slopes[i] * slopes[j], AROUND)[own]
            tensors[:, j, i] = tensors[:, i, j]
    return np.linalg.eigh(tensors)[1][:, :, 2]


def _flattest(points, normals, left, edge, spacing, rng) -> Flat | None:
    """The flat part with the most of the points that are left; None if it has too few."""
    candidates = np.flatnonzero(left)
    least = SHARE * len(points)
    if len(candidates) < least:
        return None
    seeds = rng.choice(candidates, TRIES)
    few = rng.choice(candidates, min(len(candidates), 4000), replace=False)
    offsets = (normals[seeds] * points[seeds]).sum(axis=1)
    near = abs(points[few] @ normals[seeds].T - offsets) < THICKNESS * edge
    near &= abs(normals[few] @ normals[seeds].T) > PARALLEL
    for best in np.argsort(-near.sum(axis=0))[:3]:
        plane = _fitted(points, normals, left, Plane(normals[seeds[best]], offsets[best]), edge)
        on_it = _near(points, normals, left, plane, edge)
        around = abs(plane.height(points)) < 3.0 * THICKNESS * edge
        flat, share = _outlined(points, on_it, around, plane, CELL * edge * spacing)
        if share * len(points) >= least:
            return flat
    return None


def _near(points, normals, left, plane, edge):
    near = left & (abs(plane.height(points)) < THICKNESS * edge)
    return near & (abs(normals @ plane.normal) > PARALLEL)


def _fitted(points, normals, left, plane, edge):
    """The plane again, by least squares."""
    for _ in range(5):
        near = _near(points, normals, left, plane, edge)
        if near.sum() < 3:
            return plane
        mean = points[near].mean(axis=0)
        away = points[near] - mean
        normal = np.linalg.eigh(away.T @ away)[1][:, 0]
        plane = Plane(normal, float(normal @ mean))
    return plane


def _outlined(points, on_it, around, plane, cell):
    """The largest connected part of the points on a plane, and its share of all.

    Where a plane goes through a thing, as many points lie `around` it as on it.
    """
    from scipy.ndimage import binary_closing, label

    axes = np.linalg.svd(plane.normal[None])[2][1:]
    flat = points[on_it] @ axes.T
    if not len(flat):
        return None, 0.0
    origin = flat.min(axis=0) - 2.0 * cell
    shape = np.floor((flat.max(axis=0) - origin) / cell).astype(int) + 3
    counts, all_counts = (
        _counted(points[some] @ axes.T, origin, cell, shape) for some in (on_it, around)
    )
    whole = np.ones((3, 3), bool)
    usual = np.percentile(counts[counts > 0], USUAL)
    is_flat = (counts > FEW * usual) & (counts > PURE * all_counts)
    labels, count = label(binary_closing(is_flat, whole), whole)
    sizes = np.bincount(labels.ravel(), counts.ravel(), minlength=count + 1)
    sizes[0] = 0.0
    best = int(sizes.argmax())
    share = float(sizes[best]) / len(points)
    return Flat(plane, axes, origin, labels == best, cell, share), share


def _counted(flat, origin, cell, shape):
    """How many points [n, 2] lie in each cell of a grid.  [rows, columns]"""
    index = np.floor((flat - origin) / cell).astype(int)
    index = index[((index >= 0) & (index < shape)).all(axis=1)]
    counts = np.zeros(shape, int)
    np.add.at(counts, tuple(index.T), 1)
    return counts
