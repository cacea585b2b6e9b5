"""The coarse mesh: tets of the A15 lattice, and an integer address for every vertex.

    dx                    a quarter of A15's period [model units]; 0.02 in DeformRF, section 4.1
    addresses [V, 3] int  of vertices: position at rest = (address − MARGIN) dx; none is negative
    tets      [T, 4] int  ids of the four corners; the volume at rest is positive

Model space is the unit cube; z is up.  A15 fills space with acute tets.  It repeats every 4 dx,
with 8 vertices and 46 tets.  Two vertices are joined if they are √4, √5 or √6 dx apart; four
vertices of which each two are joined are the corners of a tet.

Training begins with the tets of all periods that meet the unit cube.  It keeps those that have
density, border on such tets, or are enclosed by them.  Of the orders of a tet's corners that leave
its volume positive, it takes the one whose descendants (subdivision.py) have the best shapes.
"""

from itertools import product

import numpy as np

PERIOD, MARGIN = 4, 4
PERIOD_VERTICES = np.array(
    [[0, 0, 0], [2, 2, 2], [1, 2, 0], [3, 2, 0], [0, 1, 2], [0, 3, 2], [2, 0, 1], [2, 0, 3]]
)
SQUARED_EDGES = 4, 5, 6


def period_tets():
    """The 46 tets whose lowest corner (by x, then y, then z) is in one period.  [46, 4, 3] int"""
    shifts = PERIOD * np.array(list(product((-1, 0, 1), repeat=3)))
    vertices = np.array(sorted((PERIOD_VERTICES + shifts[:, None]).reshape(-1, 3).tolist()))
    squared = ((vertices[:, None] - vertices) ** 2).sum(axis=-1)
    joined = np.triu(np.isin(squared, SQUARED_EDGES))  # [a, b]; b is higher than a
    tets = [
        (a, b, c, d)
        for a in np.flatnonzero(((vertices >= 0) & (vertices < PERIOD)).all(axis=1))
        for b in np.flatnonzero(joined[a])
        for c in np.flatnonzero(joined[a] & joined[b])
        for d in np.flatnonzero(joined[a] & joined[b] & joined[c])
    ]
    corners = vertices[np.array(tets)]
    mirrored = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    corners[mirrored] = corners[mirrored][:, [0, 1, 3, 2]]
    return corners
