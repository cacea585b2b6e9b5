"""Which descriptors of two photographs match: each is clearly the nearest to the other.

Clearly: at most FARTHEST away, and at most RATIO times as far as the second nearest.  pycolmap's
matcher asks the same of approximately nearest ones.  Squared distances come from one matrix
product,

    |x - y|² = |x|² + |y|² - 2 x·y,

and whatever is computed on the way is a whole number of less than 2^24, so float32 is exact.
"""

import numpy as np

FARTHEST = 0.49 * 512**2  # squared: 0.7 of a descriptor's length
RATIO = 16.0, 25.0  # squared: 4 / 5
MOST = 2**19  # distances at a time: as many as a CPU's cache holds


def matches_of(one, other, most: int = MOST):
    """Matches of two photographs' features.

    Args:
        one, other: Descriptors; each component is a whole number from 0 to 255.
            [m, 128] and [k, 128] float32
        most: Distances that are in memory at a time.

    Returns:
        The feature of the one, the feature of the other.  [n] int each
    """
    i, j = clearly_nearest(one, other, most)
    rows, back = clearly_nearest(other[j], one, most)
    rows = rows[back == i[rows]]
    return i[rows], j[rows]


def clearly_nearest(queries, among, most: int):
    """Queries that have a clearly nearest feature, and which.

    Args:
        queries: [m, 128] float32
        among: [k, 128] float32

    Returns:
        The query, the feature.  [n] int each
    """
    if not (len(among) and len(queries)):
        return (np.zeros(0, np.int64),) * 2
    found = []
    squares, doubled = squares_of(among), 2.0 * among.T
    at_once = max(1, most // len(among))
    for first in range(0, len(queries), at_once):
        some = queries[first : first + at_once]
        off = some @ doubled
        np.subtract(squares, off, out=off)
        rows = np.arange(len(off))
        nearest = off.argmin(axis=1)
        own = squares_of(some)
        best = off[rows, nearest] + own
        off[rows, nearest] = np.inf
        second = off.min(axis=1) + own
        clear = np.flatnonzero((best <= FARTHEST) & (RATIO[1] * best < RATIO[0] * second))
        found.append((first + clear, nearest[clear]))
    return tuple(map(np.concatenate, zip(*found, strict=True)))


def squares_of(descriptors):
    """Their squared lengths, of arrays of NumPy or torch.  [..., 128] -> [...]"""
    return (descriptors * descriptors).sum(axis=-1)
