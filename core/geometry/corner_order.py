"""The order of a tet's corners that gives its descendants the best shapes.

The steps of the closed path v0 v1 v2 v3 are the edges a, b, c, d.  Every descendant by
Bey's children (subdivision.py) has the same four steps, scaled, in one of three cyclic
orders; its other two edges are two of p = a + b = v0v2, q = b + c = v1v3 and r = a + c,
twice the inner diagonal m02-m13.  With S = |a|² + |b|² + |c|² + |d|² = |p|² + |q|² + |r|²,
the squared edges of the three shapes sum to 2S - |p|², 2S - |q|² and 2S - |r|².  On one
level all volumes are equal, so these sums alone rank the shapes by their mean ratio,

    12 (3 volume)^(2/3) / sum of squared edge lengths,           1 for a regular tet.

They depend only on which two opposite edges are v0v2 and v1v3: of the 24 orders there are
three to choose from, and even permutations, which keep the orientation, reach them all.

Shapes: T tets.
"""

import numpy as np

from .mesh import EDGES

ORDERS = np.array([[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2]])  # even permutations
CROSSING_EDGES = np.array([[1, 4], [2, 3], [0, 5]])  # v0v2 and v1v3 of each, rows of EDGES


def best_corner_order(corners):
    """The corner order whose worst descendant is best, then best on average.

    Args:
        corners: Corner positions, exact if they are integers.  [T, 4, 3]

    Returns:
        An even permutation of each tet's corners.  Of equally good ones it is the first, so
        the best order stays as it is.  [T, 4]
    """
    ends = corners[:, EDGES]
    squared = ((ends[:, :, 0] - ends[:, :, 1]) ** 2).sum(axis=-1)
    crossing = squared[:, CROSSING_EDGES]  # [T, order, 2]
    path = squared.sum(axis=1)[:, None] - crossing.sum(axis=-1)  # S, [T, order]
    diagonal = path - crossing.sum(axis=-1)  # |r|²
    sums = 2 * path[..., None] - np.concatenate([crossing, diagonal[..., None]], axis=-1)
    sums = np.sort(sums, axis=-1)  # equal shapes then have bitwise equal means
    # Where |r|² is least, 2S - |r|² is the sum of all six squared edges, whatever the order:
    # rounding must not decide between equals.
    total = squared.sum(axis=1)[:, None]
    worst = np.where(diagonal <= crossing.min(axis=-1), total, sums[..., -1])
    mean = (1.0 / sums).sum(axis=-1)
    return ORDERS[np.lexsort((-mean, worst))[:, 0]]
