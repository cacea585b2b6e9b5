"""Search for few colors of a lattice's constraints: what KNOWN of core/geometry/coloring.py has.

Shapes: P constraints of one period, of n vertices each.
"""

import numpy as np

from deformrf.core.geometry.coloring import _keys, _period, one_period

SEARCH_STEPS = 600  # per number of colors; 400 already find the fewest


def sites(lattice, vertex_count):
    """Keys of the constraints of one period, ascending, and numbers of their vertices.  [P], [P, n]

    Vertices that differ by periods have the same number.
    """
    addresses = one_period(lattice, vertex_count)
    keys, first = np.unique(_keys(lattice, addresses), return_index=True)
    x, y, z = np.moveaxis(addresses[first] % _period(lattice), -1, 0)
    return keys, (x * _period(lattice) + y) * _period(lattice) + z


def few_colors(constraints):
    """Colors of a small set of constraints, as few as a short search finds.  [P] int"""
    touches = (constraints[:, :, None, None] == constraints[None, None]).any(axis=(1, 3))
    np.fill_diagonal(touches, False)
    count = np.unique(constraints, return_counts=True)[1].max()  # no fewer will do
    while (colors := _search(touches, count)) is None:
        count += 1
    return colors


def _search(touches, color_count):
    """A coloring with that many colors, by tabu search; None if the search fails.  [P] int"""
    random = np.random.default_rng(0)  # the same colors in every process
    each = np.arange(len(touches))
    colors = random.integers(color_count, size=len(touches))
    # Number of neighbors of each constraint with each color.
    clashes = touches.astype(int) @ (colors[:, None] == np.arange(color_count))
    forbidden_until = np.zeros_like(clashes)
    for step in range(SEARCH_STEPS):
        own = clashes[each, colors]
        if not own.any():
            return colors
        change = clashes - own[:, None] + 1000 * (forbidden_until > step)
        change[each, colors] = change[own == 0] = 10**6
        best = np.flatnonzero(change.ravel() == change.min())
        constraint, color = divmod(best[random.integers(len(best))], color_count)
        old = colors[constraint]
        colors[constraint] = color
        clashes[:, old] -= touches[constraint]
        clashes[:, color] += touches[constraint]
        forbidden_until[constraint, old] = step + 5 + random.integers(10)
    return None
