"""Where a rig's surface lies on a model: the similarity that lays one on the other.

Boxes first: for each of the 24 ways to lay one box's axes on another's, the sides of the rig's
box are compared with those of the model's, and its middle and size are taken over.  Then closest
points: each sample of one surface is paired with its nearest neighbor on the other, in both
directions, and the similarity of least squares for these pairs is the next guess (Besl and McKay
1992; Umeyama 1991).  The guess with the smallest distance in the end is taken; upright ones, and
the one that is not turned at all, are preferred.

Shapes: S samples of the rig's surface, N points of the model's matter.
"""

from itertools import permutations, product

import numpy as np

COARSE, FINE = 300, 1500  # samples of each surface
TURNED, FALLEN = 1.1, 1.5  # by how much a distance counts more if the rig is turned, or not upright
ROUNDS, FINE_ROUNDS = 12, 40
MOST_GUESSES = 8
CELLS = 30
NEAR = 0.9  # share of the pairs that count: the farthest are of what only one of both has


def align(points: np.ndarray, matter: np.ndarray) -> np.ndarray:
    """The similarity from the rig's space to the model's.  [4, 4]

    Args:
        points: Samples of the rig's surface [S, 3].
        matter: Points of the object's surface in the model [N, 3].

    Raises:
        ValueError: One of both has no size.
    """
    if not all(len(places) and np.ptp(places, axis=0).any() for places in (points, matter)):
        raise ValueError(
            "the rig's surface or the model has no size, so one can't be laid on the other"
        )
    few, many = ((_some(points, n), _some(matter, n)) for n in (COARSE, FINE))
    guesses = sorted(_guesses(points, matter), key=lambda guess: guess[0])[:MOST_GUESSES]
    best = None
    for _, penalty, matrix in guesses:
        matrix, distance = _closest_points(*few, matrix, ROUNDS)
        if best is None or distance * penalty < best[0]:
            best = distance * penalty, matrix
    return _closest_points(*many, best[1], FINE_ROUNDS)[0]


def outer_points(places: np.ndarray, spacing: float) -> np.ndarray:
    """Of points that fill a body, those at its surface: they have an empty neighbor in a grid.

    Args:
        places: [N, 3]
        spacing: Of the grid; a bit more than that of the points.
    """
    cells = np.floor((places - places.min(axis=0)) / spacing).astype(np.int64) + 1
    full = np.zeros(cells.max(axis=0) + 2, bool)
    full[tuple(cells.T)] = True
    return places[_grown(~full)[tuple(cells.T)]]


def shared_space(points: np.ndarray, matter: np.ndarray) -> float:
    """How much of the space that two bodies fill is filled by both: intersection over union.

    A body is what points of its surface enclose on a grid of CELLS cells along the second one's
    diagonal; gaps of two cells in the surface let nothing in.

    Args:
        points: Samples of the first body's surface [S, 3].
        matter: Points of the second one's [N, 3].
    """
    cell = float(np.linalg.norm(np.ptp(matter, axis=0))) / CELLS
    low, high = matter.min(axis=0), matter.max(axis=0)
    near = ((points >= low - (high - low)) & (points <= high + (high - low))).all(axis=1)
    if not near.any():
        return 0.0
    share = near.mean()  # what is farther off than the other one's size shares nothing
    points = points[near]
    low = np.minimum(low, points.min(axis=0)) - 3.5 * cell
    shape = tuple(((np.maximum(high, points.max(axis=0)) - low) / cell + 4.5).astype(int))
    first, second = (_enclosed(((p - low) / cell).astype(int), shape) for p in (points, matter))
    return float(share * (first & second).sum() / (first | second).sum())


def _enclosed(cells, shape):
    """Cells that can't be reached from a grid's first corner past the given ones.  bool [shape]"""
    full = np.zeros(shape, bool)
    full[tuple(cells.T)] = True
    wall, outside = _grown(full), np.zeros(shape, bool)
    outside[0, 0, 0] = True
    while True:
        reached = _grown(outside) & ~wall
        if (reached == outside).all():
            return ~_grown(outside) | full
        outside = reached


def _grown(cells):
    """Cells, and their six neighbors."""
    found = cells.copy()
    for axis in range(3):
        a, b = np.moveaxis(found, axis, 0), np.moveaxis(cells, axis, 0)
        a[1:] |= b[:-1]
        a[:-1] |= b[1:]
    return found


def _guesses(points, matter):
    """How badly boxes fit, the penalty of the turn, and the matrix, for each of 24 turns."""
    low, high = points.min(axis=0), points.max(axis=0)
    low_, high_ = np.quantile(matter, [0.002, 0.998], axis=0)  # specks do not count
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) < 0.0:
                continue
            sides, wanted = np.abs(turn) @ (high - low), high_ - low_
            scale = float(sides @ wanted / (sides @ sides))
            misfit = np.linalg.norm(scale * sides - wanted) / np.linalg.norm(wanted)
            penalty = 1.0
            if turn[2, 2] != 1.0:
                penalty = FALLEN
            elif turn[0, 0] != 1.0:
                penalty = TURNED
            matrix = np.eye(4)
            matrix[:3, :3] = scale * turn
            matrix[:3, 3] = 0.5 * (low_ + high_) - matrix[:3, :3] @ (0.5 * (low + high))
            yield (misfit + 0.05) * penalty, penalty, matrix


def _closest_points(points, matter, matrix, rounds: int):
    """The matrix after so many rounds, and the mean distance of the nearest pairs."""
    distance = np.inf
    for _ in range(rounds):
        placed = points @ matrix[:3, :3].T + matrix[:3, 3]
        squared = (
            np.sum(placed**2, axis=1)[:, None] + np.sum(matter**2, axis=1) - 2.0 * placed @ matter.T
        )
        there, back = squared.argmin(axis=1), squared.argmin(axis=0)
        sources = np.concatenate([points, points[back]])
        targets = np.concatenate([matter[there], matter])
        lengths = np.sqrt(np.maximum(np.concatenate([squared.min(axis=1), squared.min(axis=0)]), 0))
        near = lengths <= np.quantile(lengths, NEAR)
        before, distance = distance, float(lengths[near].mean())
        if before - distance < 1e-6 * distance:
            break
        matrix = similarity(sources[near], targets[near])
    return matrix, distance


def similarity(sources, targets):
    """The similarity of least squares that takes points to others [n, 3]: Umeyama 1991.  [4, 4]"""
    a, b = sources.mean(axis=0), targets.mean(axis=0)
    u, sizes, vt = np.linalg.svd((targets - b).T @ (sources - a))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = (sizes * signs).sum() / max(np.sum((sources - a) ** 2), 1e-30)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * (u * signs) @ vt
    matrix[:3, 3] = b - matrix[:3, :3] @ a
    return matrix


def _some(points, count):
    """At most so many of the points, the same each time."""
    if len(points) <= count:
        return points
    return points[np.random.default_rng(0).choice(len(points), count, replace=False)]
