"""Find the object: the plane on which it stands, the up direction, and the box around it.

The input is points on surfaces, from structure from motion or from a coarse field's depths.
A point's *attention* is high if cameras see it near the middle of their images.  RANSAC, then
least squares, finds planes whose points have much attention, with the cameras in front of them.
The points in front of a plane form clusters of near neighbors; the object is the cluster with the
most attention.  There may be several planes, for example a table and the floor.  The highest one
is taken that has an object on it and hardly any points below that object.  (Spread arms also lie
in a plane, but the body continues below it.)

If the plane's normal is within 70° of the cameras' common up, the object stands on the plane, and
the normal is up.  Otherwise the object hangs on the plane, as on a wall, and up is the cameras' up,
projected into the plane.

Shapes: n points, N cameras.  Lengths are in the data's units; below, the scale is the median
distance of the cameras from the point that they look at.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...geometry import Plane, heaviest_plane
from ...render import Lens
from .views import common_up, focus, upright

POINTS_MAX, PAIRED_MAX = 20_000, 6_000  # that a plane, that clusters are made of
FAR = 1.5  # farther from the focus points don't count [scale]
BELL = 0.6  # standard deviation of attention, over half the image's shorter side
THICKNESS = 0.012  # of a plane to each side [scale]
PLANES = 8
PLANE_SHARE = 0.03  # of the attention that a plane has at least
CAMERAS_IN_FRONT = 0.95  # of the cameras
STANDS = 0.35  # cosine between the plane's normal and the cameras' up from which the object stands
CLEAR = 3.0  # thicknesses: what is nearer to the plane belongs to it
CELL = 0.1  # of a plane, a square's side [scale]
NEIGHBOURS = 6  # of a point in a cluster
REACH_OF_POINT = 3.0  # of the median distance to that many neighbours
CLUSTER_SHARE = 0.2  # of the attention in front of the plane that an object has at least
OTHER_SHARE = 0.02  # of the object's attention that something else has at least, to be told
VOTE = 0.5  # of a point's attention: in so many views masks have to have it
OBJECT_SHARE = 0.1  # of all attention that it has at least
BELOW, AS_GOOD = 0.3, 0.05  # attention below a plane, where the object is, over that above
FOOTPRINT = 80.0  # percent of the object's points that lie over its footprint
FEWEST_POINTS = 40  # of an object
OUTLIERS = 0.3  # percent of its points at each side of the box
MARGIN = 0.12  # around them: what is thin is missing among points [the box's longest side]
GROUND_THICKNESS = 0.008  # to each side [model units]
SAME_TILT, GROUND_SHARE = 0.985, 0.15  # cosine to the guess; of the points near it


@dataclass(frozen=True)
class FoundObject:
    """The object's place.

    Attributes:
        turn: Rotation from the data's space to one with the object upright.  [3, 3]
        box: Lowest and highest corner after the turn; it begins at the plane.  [2, 3]
        stands: Whether the plane is below the object, not behind it.
        others: Boxes of other things on the plane, which are left out, in the data's space; the
            one that is looked at most first.  [m, 2, 3]
    """

    turn: np.ndarray
    box: np.ndarray
    stands: bool
    others: tuple = ()


def find_object(
    points: ArrayLike,
    poses: np.ndarray,
    lenses: Sequence[Lens],
    masks: Callable[[int], np.ndarray | None] | None = None,
) -> FoundObject | None:
    """Find the object among points of surfaces; None if it isn't clear where it is.

    Args:
        points: [n, 3]
        poses: Camera to world, OpenGL's axes.  [N, 4, 4]
        lenses: [N]
        masks: Given a view, how much of its pixels is the object's [H, W], 0..255.  They vote on
            what may be the object.

    Raises:
        DatasetError: The cameras don't look at one place.
    """
    rng = np.random.default_rng(0)
    center = focus(poses)
    scale = np.median(np.linalg.norm(poses[:, :3, 3] - center, axis=1))
    points = np.asarray(points, float)
    near = np.isfinite(points).all(axis=1)
    near[near] = np.linalg.norm(points[near] - center, axis=1) < FAR * scale
    points = some(points[near], POINTS_MAX, rng)
    if len(points) < FEWEST_POINTS:
        return None
    weights = attention(points, poses, lenses)
    votes = weights if masks is None else attention(points, poses, lenses, masks)
    up = common_up(poses)
    found, cameras = [], poses[:, :3, 3]
    for plane in planes(points, weights, cameras, up, THICKNESS * scale, rng):
        plane = evened(plane, points, weights, cameras, scale, rng)
        heights = plane.height(points)
        is_above, is_below = (side * heights > CLEAR * THICKNESS * scale for side in (1.0, -1.0))
        is_above &= votes >= VOTE * weights
        clusters = watched_clusters(points[is_above], weights[is_above], votes.sum(), rng)
        chosen = clusters[0] if clusters else None
        if chosen is None or not carries(plane, points[abs(heights) < THICKNESS * scale], chosen):
            continue
        above, below = over_footprint(plane, chosen, points, weights, is_above, is_below)
        if below < BELOW * above:
            found.append((below / above, plane, clusters))
    if not found:
        return None
    least = min(share for share, *_ in found)
    plane, (chosen, *others) = next(rest for share, *rest in found if share <= least + AS_GOOD)
    stands = bool(plane.normal @ up > STANDS)
    turn = upright(plane.normal) if stands else against_wall(plane.normal, up)
    low, high = np.percentile(chosen @ turn.T, [OUTLIERS, 100.0 - OUTLIERS], axis=0)
    margin = MARGIN * (high - low).max()
    low, high = low - margin, high + margin
    axis = 2 if stands else 1
    if stands:
        low[axis] = plane.offset
    else:  # the wall's normal is -y
        high[axis] = -plane.offset
    touches = 2.0 * CLEAR * THICKNESS * scale  # in front of the plane: what is there is on it
    others = [points for points in others if plane.height(points).min() < touches]
    others = [(points.min(axis=0), points.max(axis=0)) for points in others]
    return FoundObject(turn, np.array([low, high]), stands, tuple(map(np.array, others)))


def ground_of(points, guess: Plane, slack: float) -> Plane:
    """The plane that surface points near a guess lie on; the guess if too few do.

    Lengths are those of model space, where the object is about 1 long.

    Args:
        slack: How near points have to be to the guess.
    """
    rng = np.random.default_rng(0)
    low = some(points[abs(guess.height(points)) < slack], POINTS_MAX, rng)
    plane = heaviest_plane(low, np.ones(len(low)), GROUND_THICKNESS, rng)
    if plane is None:
        return guess
    if plane.normal @ guess.normal < 0.0:
        plane = Plane(-plane.normal, -plane.offset)
    share = (abs(plane.height(low)) < GROUND_THICKNESS).mean()
    is_good = plane.normal @ guess.normal > SAME_TILT and share > GROUND_SHARE
    return plane if is_good else guess


def some(array, count, rng):
    """At most `count` of the rows, drawn at random."""
    return array if len(array) <= count else array[rng.choice(len(array), count, replace=False)]


def attention(points, poses, lenses, masks=None):
    """How much the cameras look at points, 0..1, where masks have the object.  [n]"""
    total = np.zeros(len(points))
    for view, (pose, lens) in enumerate(zip(poses, lenses, strict=True)):
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        depth = -local[:, 2]
        in_front = depth > 0.0
        depth = np.where(in_front, depth, 1.0)
        x, y = lens.focal[0] * local[:, 0] / depth, lens.focal[1] * local[:, 1] / depth
        x, y = x + lens.center[0] - 0.5 * lens.width, y - lens.center[1] + 0.5 * lens.height
        seen = in_front & (abs(x) < 0.5 * lens.width) & (abs(y) < 0.5 * lens.height)
        sigma = BELL * 0.5 * min(lens.width, lens.height)
        looks = seen * np.exp(-0.5 * (x**2 + y**2) / sigma**2)
        if masks is not None:
            column = np.clip(x + 0.5 * lens.width, 0, lens.width - 1).astype(int)
            row = np.clip(0.5 * lens.height - y, 0, lens.height - 1).astype(int)
            looks *= masks(view)[row, column] / 255.0
        total += looks
    return total / len(poses)


def planes(points, weights, cameras, up, thickness, rng) -> list[Plane]:
    """Planes that the object may stand on, the highest first, and then those it may hang on.

    All of them have enough attention, and the cameras are in front of them.
    """
    left, found = np.ones(len(points), bool), []
    for _ in range(PLANES):
        plane = heaviest_plane(points[left], weights[left], thickness, rng)
        if plane is None:
            break
        sides = plane.height(cameras)
        if np.median(sides) < 0.0:
            plane, sides = Plane(-plane.normal, -plane.offset), -sides
        distances = abs(plane.height(points))
        share = weights[left & (distances < thickness)].sum() / weights.sum()
        left &= distances > CLEAR * thickness
        if share >= PLANE_SHARE and (sides > 0.0).mean() >= CAMERAS_IN_FRONT:
            stands = bool(plane.normal @ up > STANDS)
            # The nearer to the cameras the higher; of walls, the one that is looked at most.
            found.append((stands, -np.median(sides) if stands else share, plane))
    return [plane for *_, plane in sorted(found, key=lambda entry: entry[:2], reverse=True)]


def evened(plane: Plane, points, weights, cameras, scale, rng) -> Plane:
    """Refit the plane with equal weight for each cell of area.

    So a densely textured mat doesn't tilt it.  The old plane where the refit tilts by more than
    10°, or fails the checks of `planes`.

    Args:
        points, weights: [n, 3], [n]
        cameras: [N, 3]
    """
    thickness = THICKNESS * scale
    near = abs(plane.height(points)) < CLEAR * thickness
    across = points[near] @ upright(plane.normal)[:2].T
    cells = np.floor(across / (CELL * scale)).astype(int)
    _, cell, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    # A single point in a cell may be an outlier.  NumPy 2.0.0 gives `cell` as [m, 1].
    even = weights[near] * ((counts > 1) / counts)[cell.ravel()]
    found = heaviest_plane(points[near], even, thickness, rng)
    if found is None:
        return plane
    if found.normal @ plane.normal < 0.0:
        found = Plane(-found.normal, -found.offset)
    share = weights[abs(found.height(points)) < thickness].sum() / weights.sum()
    in_front = (found.height(cameras) > 0.0).mean()
    is_good = found.normal @ plane.normal > SAME_TILT and share >= PLANE_SHARE
    return found if is_good and in_front >= CAMERAS_IN_FRONT else plane


def carries(plane: Plane, ground, points) -> bool:
    """Whether the ground's points [m, 3] on a plane reach farther than the object's [n, 3]."""

    def extent(places):
        flat = flattened(plane, places)
        return np.linalg.norm(flat - np.median(flat, axis=0), axis=1).mean()

    return len(ground) > 0 and extent(ground) > extent(points)


def over_footprint(plane: Plane, chosen, points, weights, *groups):
    """The attention of each group of the points [n] where the object's `chosen` [m, 3] lie."""
    flat = flattened(plane, chosen)
    center = np.median(flat, axis=0)
    radius = np.percentile(np.linalg.norm(flat - center, axis=1), FOOTPRINT)
    is_over = np.linalg.norm(flattened(plane, points) - center, axis=1) < radius
    return [weights[group & is_over].sum() for group in groups]


def flattened(plane: Plane, points):
    """Points moved along a plane's normal to the plane through 0.  [n, 3]"""
    return points - points @ plane.normal[:, None] * plane.normal


def watched_clusters(points, weights, total, rng):
    """The points of the cluster with the most attention, then of others that are things, too.

    Returns:
        Points of each [m, 3], those with more attention first; none if the first has too little.

    Args:
        total: Attention of all points, those below the plane too.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if len(points) < FEWEST_POINTS:
        return []
    if len(points) > PAIRED_MAX:
        few = rng.choice(len(points), PAIRED_MAX, replace=False)
        total *= len(few) / len(points)
        points, weights = points[few], weights[few]
    tree = cKDTree(points)
    distances = tree.query(points, NEIGHBOURS + 1)[0][:, -1]
    reach = REACH_OF_POINT * np.median(distances)
    is_dense = distances < reach
    points, weights = points[is_dense], weights[is_dense]
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
    labels = connected_components(graph, directed=False)[1]
    scores = np.bincount(labels, weights)
    counts = np.bincount(labels)
    order = np.argsort(-scores)
    best = order[0]
    enough = max(CLUSTER_SHARE * weights.sum(), OBJECT_SHARE * total)
    if counts[best] < FEWEST_POINTS or scores[best] < enough:
        return []
    least = OTHER_SHARE * scores[best]
    things = [k for k in order[1:] if counts[k] >= FEWEST_POINTS and scores[k] >= least]
    return [points[labels == k] for k in (best, *things)]


def against_wall(normal, up):
    """The rotation that takes up to about +z, and a wall's normal to -y.  [3, 3]"""
    z = up - (up @ normal) * normal
    z /= np.linalg.norm(z)
    y = -normal
    return np.array([np.cross(y, z), y, z])
