"""Addresses and few colors for a mesh that was cut from a lattice.

Constraints that are translates of each other by the lattice's period have the same color.  So
a lattice needs colors only for the constraints of one period, a graph small enough for a
search.  A vertex of A15 has at most 24 tets, and 26 colors suffice for all.

Shapes: V vertices, C constraints of n vertices, P constraints of one period.
"""

from functools import cache
from itertools import product

import numpy as np

from .lattice import A15, BCC, KUHN, Lattice, cell_tets
from .mesh import EDGES

TOLERANCE = 0.02  # of dx; float32 vertices are 1e-4 of it away
SHARE = 0.9  # of the vertices that have to be on the lattice
SEARCH_STEPS = 600  # per number of colors; 400 already find the fewest


def lattice_addresses(rest_vertices):
    """The lattice that a mesh was cut from, axes along those of space.

    Args:
        rest_vertices: [V, 3]

    Returns:
        The lattice, integer addresses modulo its cell [V, 3], and which vertices are on it
        [V] bool; None if fewer than a share of SHARE are.
    """
    spacing = _spacing(rest_vertices)
    if spacing is None:
        return None
    places = (rest_vertices - rest_vertices[0]) / spacing
    addresses = np.rint(places).astype(np.int64)
    near = np.abs(places - addresses).max(axis=1) < TOLERANCE
    if near.mean() < SHARE:
        return None
    for lattice in (A15, BCC, KUHN):
        shift, share = _best_shift(lattice, addresses[near])
        if share > SHARE:
            return lattice, addresses + shift, near & _is_site(lattice, addresses + shift)
    return None


def _spacing(rest_vertices):
    """An estimate of dx: the median distance between neighboring coordinates, or None."""
    steps = []
    for axis in range(3):
        levels = np.unique(rest_vertices[:, axis])
        gaps = np.diff(levels)
        gaps = gaps[gaps > 1e-4 * max(np.ptp(levels), 1e-30)]
        if len(gaps):
            steps.append(np.median(gaps))
    return min(steps, default=None)


def _is_site(lattice, addresses):
    sites = np.zeros((lattice.cell_edge,) * 3, bool)
    sites[tuple(np.array(lattice.cell_vertices).T)] = True
    return sites[tuple((addresses % lattice.cell_edge).T)]


def _best_shift(lattice, addresses):
    """The shift that makes most addresses vertices of the lattice, and their share."""
    some = addresses[:: max(len(addresses) // 1000, 1)]
    shifts = np.array(list(product(range(lattice.cell_edge), repeat=3)))
    shares = [_is_site(lattice, some + shift).mean() for shift in shifts]
    return shifts[np.argmax(shares)], max(shares)


def periodic_classes(lattice: Lattice, addresses):
    """Color and class of constraints; the translates of a constraint share one class.

    Args:
        addresses: Addresses of their vertices.  [C, n, 3] int

    Returns:
        Two arrays [C] int; -1 for constraints that are not of the lattice.
    """
    keys, colors = _table(lattice, addresses.shape[1])
    key = _keys(lattice, addresses)
    place = np.clip(np.searchsorted(keys, key), 0, len(keys) - 1)
    found = keys[place] == key
    return np.where(found, colors[place], -1), np.where(found, place, -1)


def _period(lattice):
    """The period in dx, such that no constraint has two translates of one vertex."""
    return lattice.cell_edge if lattice is A15 else 2 * lattice.cell_edge


def _keys(lattice, addresses):
    """A number from middle and spread that a translation by the period keeps.  [C]"""
    count = addresses.shape[1]
    total = addresses.sum(axis=1)
    spread = count * (addresses**2).sum(axis=(1, 2)) - (total**2).sum(axis=1)
    period = count * _period(lattice)
    x, y, z = (total % period).T
    return ((spread * period + x) * period + y) * period + z


@cache
def _table(lattice, vertex_count):
    """Keys of the constraints of one period, ascending, and their colors.  [P], [P]"""
    tets = cell_tets(lattice)
    period = _period(lattice)
    repeats = np.array(list(product(range(0, period, lattice.cell_edge), repeat=3)))
    tets = (tets[None] + repeats[:, None, None]).reshape(-1, 4, 3)
    constraints = tets if vertex_count == 4 else tets[:, EDGES].reshape(-1, 2, 3)
    keys, first = np.unique(_keys(lattice, constraints), return_index=True)
    x, y, z = np.moveaxis(constraints[first] % period, -1, 0)
    return keys, _few_colors((x * period + y) * period + z)


def _few_colors(constraints):
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
