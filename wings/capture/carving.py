"""Mattes of a whole capture, by the votes of all its views.

A single matte (mattes.py) leaves pixels open, and calls shadows the object.  Space decides: each
small cube of space is seen by every view, as background, as the object, or as something unknown.
What MOST of the views that know something call background is empty (space carving, Kutulakos and
Seitz 2000, with errors).  The silhouettes of the rest, the hull, say of each pixel

* well within a silhouette: the object;
* outside: the background;
* near its edge: what the pixel's own matte says.

Where a matte is open within the silhouette of the hull, the silhouette of the cubes that are sure
decides: those well inside the hull, and those that views saw as the object.  What lies outside of
that one remains UNTOLD, as are shadows around the object's feet that lie there in each view.

A program that segments single photographs (masking.py) now and then sees something else, or half of
the object, and one in five such mattes would carve the object away.  So `agreeing` asks first which
mattes fit the hull that all others leave, and the rest loses its vote.
"""

from dataclasses import dataclass
from itertools import compress

import numpy as np

from ...core.training import UNTOLD
from .mattes import BACKGROUND, OBJECT, UNKNOWN

COARSE, FINE = 32, 128  # cubes along a side of the space, at first and in the end
WIDER = 1.4  # than the box of the sparse points is the space
FEWEST = 10  # sparse points that tell where the object is
OUTLIERS = 1.0  # percent of these points at each side
MOST = 0.15  # of the views that know something
# Of mattes that may be wrong as a whole: the views that call a cube empty; the share of the others'
# agreement with the hull that a matte needs.  The first hull is too large, since a third of its
# views may be wrong, so what fits badly there goes before a tighter one is asked.
LOOSE = 0.4
PASSES = ((LOOSE, 0.6), (0.25, 0.7))
HALF = 0.5  # how much a view counts that doesn't know
SEEN = 0.5  # of the views saw a cube as the object: then it is sure
DEEP = 6  # cubes from the hull's surface, from where on all are sure
WITHIN, BEYOND = 2, 2  # cubes of the hull, as wide as pixels, in which the pixel's matte decides


@dataclass(frozen=True)
class View:
    """A view, and its matte.

    Attributes:
        pose: Camera to world, OpenGL's axes.  [4, 4]
        lens: As in mapping.Mapped, for the matte's size.  [7]
        matte: [h, w] uint8; None where nothing tells.
    """

    pose: np.ndarray
    lens: np.ndarray
    matte: np.ndarray | None


@dataclass(frozen=True)
class Hull:
    """Cubes that are not empty.

    Attributes:
        edge: The length of their edges.
        shell: Centers of those at the surface, which hide all others.  [n, 3]
        sure_shell: The same of those that are sure.  [m, 3]
    """

    edge: float
    shell: np.ndarray
    sure_shell: np.ndarray

    @property
    def box(self):
        """[2, 3]"""
        half = 0.5 * self.edge
        return np.array([self.shell.min(axis=0) - half, self.shell.max(axis=0) + half])


def pixels_of(view: View, points):
    """Columns and rows of points in a view's image, and which of them are there.  [n] each"""
    focal_x, focal_y, x, y, k, width, height = view.lens
    local = (points - view.pose[:3, 3].astype(np.float32)) @ view.pose[:3, :3].astype(np.float32)
    depth = np.maximum(-local[:, 2], 1e-9)
    q = local[:, :2] * np.float32([1.0, -1.0]) / depth[:, None]
    q *= (1.0 + k * (q**2).sum(axis=1, keepdims=True)).astype(np.float32)
    place = np.floor(q * np.float32([focal_x, focal_y]) + np.float32([x, y]))
    place = np.clip(place, -1, max(width, height)).astype(np.int32)
    there = (local[:, 2] < 0.0) & (place >= 0).all(axis=1) & (place < [width, height]).all(axis=1)
    return *np.where(there[:, None], place, 0).T, there


def votes(views, points, most: float = MOST):
    """Which points are not empty, and how many of the views saw the object there.  [n] both"""
    empty, unknown, filled = np.zeros((3, len(points)), np.int32)
    for view in views:
        columns, rows, there = pixels_of(view, points)
        found = view.matte[rows, columns]
        empty += there & (found == BACKGROUND)
        unknown += there & (found == UNKNOWN)
        filled += there & (found > UNKNOWN)
    known = empty + filled + HALF * unknown
    return empty < most * known, filled / np.maximum(known, 1.0)


def levels() -> int:
    """How many sizes of cubes `carve` goes through."""
    return int(np.log2(FINE // COARSE)) + 1


def carve(views, points, advance=lambda count: None, most: float = MOST) -> Hull | None:
    """Carve the space around sparse points, coarse to fine; None if nothing is left.

    Args:
        views: Those with mattes.
        points: [n, 3]
        most: Of the views that know something: as many may call a cube empty that is none.
    """
    from scipy.ndimage import binary_dilation, binary_erosion

    if len(points) < FEWEST:
        return None
    low, high = np.percentile(points, [OUTLIERS, 100.0 - OUTLIERS], axis=0)
    half = 0.5 * WIDER * (high - low).max()
    begin, edge = 0.5 * (low + high) - half, 2.0 * half / COARSE
    cubes = np.stack(np.meshgrid(*3 * [np.arange(COARSE)], indexing="ij"), -1).reshape(-1, 3)
    size, done = COARSE, 0
    while True:
        centers = (begin + edge * (cubes + 0.5)).astype(np.float32)
        filled, seen = votes(views, centers, most)
        done += 1
        advance(done)
        if not filled.any():
            return None
        grid = np.zeros((size + 2,) * 3, bool)
        grid[tuple(cubes[filled].T + 1)] = True
        if size >= FINE:
            inner, deep = (binary_erosion(grid, iterations=n) for n in (1, DEEP))
            sure = np.zeros_like(grid)
            sure[tuple(cubes[filled].T + 1)] = seen[filled] > SEEN
            sure = inner & (deep | sure)
            shells = grid & ~inner, sure & ~binary_erosion(sure)
            places = (begin + edge * (np.argwhere(shell) - 0.5) for shell in shells)
            return Hull(edge, *(place.astype(np.float32) for place in places))
        # What lies beside a filled cube may hold filled ones too small for this size.
        kept = np.argwhere(binary_dilation(grid, np.ones((3, 3, 3)))[1:-1, 1:-1, 1:-1])
        children = np.stack(np.meshgrid(*3 * [np.arange(2)], indexing="ij"), -1).reshape(-1, 3)
        cubes = (2 * kept[:, None] + children).reshape(-1, 3)
        size, edge = 2 * size, 0.5 * edge


def agreeing(views, points) -> np.ndarray:
    """Which views have mattes that fit the hull of all; none if there is no such hull.  [n] bool

    Args:
        views: [n]
        points: [m, 3]
    """
    fit = np.array([v.matte is not None and (v.matte != UNKNOWN).any() for v in views])
    for most, share in PASSES:
        voting = list(compress(views, fit))
        if not voting or (hull := carve(voting, points, most=most)) is None:
            return np.zeros(len(views), bool)
        covered = (silhouette(view, hull.shell, hull.edge)[0] for view in voting)
        shares = [overlap(c, v.matte > UNKNOWN) for c, v in zip(covered, voting, strict=True)]
        fit[fit] = shares >= share * np.median(shares)
    return fit


def overlap(one, other) -> float:
    """Intersection over union.  [h, w] bool, both"""
    return np.count_nonzero(one & other) / max(np.count_nonzero(one | other), 1)


def silhouette(view: View, centers, edge: float):
    """The pixels that a shell covers, and the width of a cube in pixels.  [h, w] bool, int"""
    from scipy.ndimage import binary_closing

    width, height = view.lens[5:].astype(int)
    image = np.zeros((height, width), bool)
    if not len(centers):
        return image, 1
    columns, rows, there = pixels_of(view, centers)
    image[rows[there], columns[there]] = True
    depth = np.median(np.linalg.norm(centers - view.pose[:3, 3], axis=1))
    cube = max(1, int(np.ceil(view.lens[:2].max() * edge / depth)))
    padded = np.pad(image, 2 * cube)
    closed = binary_closing(padded, np.ones((3, 3)), iterations=cube)
    return closed[2 * cube : -2 * cube, 2 * cube : -2 * cube], cube


def voted(view: View, hull: Hull) -> np.ndarray:
    """How much of each pixel is the object's after the votes, 0 to 255, or UNTOLD.  [h, w] uint8"""
    from scipy.ndimage import binary_dilation, binary_erosion, label

    covered, cube = silhouette(view, hull.shell, hull.edge)
    if view.matte is None:
        return np.where(covered, np.uint8(255), np.uint8(0))
    square = np.ones((3, 3))
    within = binary_erosion(covered, square, iterations=WITHIN * cube, border_value=True)
    beyond = binary_dilation(covered, square, iterations=BEYOND * cube)
    shares = (view.matte.astype(float) - UNKNOWN) / (OBJECT - UNKNOWN)
    own = np.where(beyond, np.maximum(shares, 0.0), 0.0)
    is_open = (view.matte == UNKNOWN) & covered
    own[within | is_open] = 1.0
    # A hole of the matte that lies all within the silhouette is none.
    holes, count = label(own <= 0.5)
    open_ones = np.unique(holes[~covered])
    own[np.isin(holes, np.setdiff1d(np.arange(1, count + 1), open_ones))] = 1.0
    is_sure = silhouette(view, hull.sure_shell, hull.edge)[0]
    shares = (255.0 * own).round().astype(np.uint8)
    shares[is_open & ~is_sure] = UNTOLD
    return shares
