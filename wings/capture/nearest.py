"""Which descriptors of two photographs match: each is clearly the nearest to the other.

Clearly: at most FARTHEST away, and at most RATIO times as far as the second nearest.  pycolmap's
matcher asks the same of approximately nearest ones.  Squared distances come from one matrix
product,

    |x - y|² = |x|² + |y|² - 2 x·y,

and whatever is computed on the way is a whole number of less than 2^24, so float32 is exact, on a
CPU as on a GPU.  Arrays are NumPy's or torch's: `xp` is the module.
"""

import numpy as np

FARTHEST = 0.49 * 512**2  # squared: 0.7 of a descriptor's length
RATIO = 16.0, 25.0  # squared: 4 / 5
MOST = 2**19  # distances at a time: as many as a CPU's cache holds


def matches_of(one, others, xp=np, most: int = MOST):
    """Matches of a photograph's features with those of others.

    Args:
        one: Its descriptors; each component is a whole number from 0 to 255.  [m, 128] float32
        others: Those of the others; zeros where one has fewer.  [count, k, 128] float32
        most: Distances that are in memory at a time.

    Returns:
        Which of the others, the feature of the one, the feature of the other.  [n] int each
    """
    which, i, j = clearly_nearest(one, others, xp, most)
    _, rows, back = clearly_nearest(others[which, j], one[None], xp, most)
    rows = rows[back == i[rows]]
    return which[rows], i[rows], j[rows]


def clearly_nearest(queries, among, xp, most: int):
    """The features of photographs that are clearly nearest to queries.

    Args:
        queries: [m, 128] float32
        among: [count, k, 128] float32

    Returns:
        The photograph, the query, the feature.  [n] int each, in that order for each few queries
    """
    count, k, _ = among.shape
    if not (count * k and len(queries)):
        return (xp.zeros_like(queries[:0, 0], dtype=xp.int64),) * 3
    found = []
    squares, doubled = squares_of(among, xp)[:, None], 2.0 * among.mT
    at_once = max(1, most // (count * k))
    for first in range(0, len(queries), at_once):
        some = queries[first : first + at_once]
        off = some @ doubled
        off = xp.subtract(squares, off, out=off).reshape(-1, k)
        rows = xp.arange(len(off), device=off.device)
        nearest = off.argmin(1)
        own = xp.tile(squares_of(some, xp), (count,))
        best = off[rows, nearest] + own
        off[rows, nearest] = xp.inf
        second = xp.amin(off, 1) + own
        clear = xp.where((best <= FARTHEST) & (RATIO[1] * best < RATIO[0] * second))[0]
        found.append((clear // len(some), first + clear % len(some), nearest[clear]))
    return tuple(map(xp.concatenate, zip(*found, strict=True)))


def squares_of(descriptors, xp):
    """Their squared lengths; infinite where there is no feature.  [..., 128] -> [...]"""
    squares = (descriptors * descriptors).sum(-1)
    return xp.where(squares > 0.0, squares, xp.inf)
