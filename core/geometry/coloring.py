"""Color the constraints, so that the solver can project all constraints of one color at once.

Two constraints that share a vertex get different colors.  Projecting color after color is then
a Gauss–Seidel sweep, whose result does not depend on the order within a color.  Each color costs a
barrier in each substep, so fewer colors are faster.

A mesh cut from a lattice takes the lattice's colors.  Constraints that differ by a translation of
the lattice get the same color, so only the constraints of one period have to be colored, once for
all time (KNOWN).  A15 needs 14 colors for edges and 26 for tets this way; greedy
coloring takes 18 and 32.  (A vertex of A15 has up to 24 tets.)

Shapes: V vertices, C constraints of n vertices each (n = 2 for edges, 4 for tets), P
constraints of one period.
"""

from functools import cache
from itertools import product

import numpy as np

from .lattice import A15, BCC, KUHN, Lattice, cell_tets
from .mesh import EDGES

TOLERANCE = 0.02  # of dx; float32 vertices are 1e-4 of it away
SHARE = 0.9  # of the vertices that have to be on the lattice
# Colors of the constraints of one period, as digits of base 36, by lattice and number of vertices
# of a constraint: the fewest that the search of tests/support/color_search.py finds.
KNOWN = {
    (A15, 2): "755328102493766a274d159c5c30dadb1c8adb60a401b7c9984263",
    (A15, 4): "8ndgfp1o7lgn6fphd81o7lh6am50jib42c9e3kc24bk3e9",
    (BCC, 2): "d07b46409b9105dac16d3b12dc703ab29c077465c501097a36b9808d37db4a958"
    "c7a1c5c2636172589a2a38458453a89b1dc6b43216d2482",
    (BCC, 4): "n5cbflgjn56hcmgj2e41ka8l7a09i3hmd9d734bie2860g1f5kflbcjn5kmch6jnd"
    "g47ial1a980hme32829be34kd160if7",
    (KUHN, 2): "68a34815273c980a87c33b907c09cab2627d146540d1ab594d2b651d",
    (KUHN, 4): "k9c4dm108jhlbanh5cdm61k39fe0i2g47l8jn7ba6ei25g3f",
}


def color_order(
    constraints: np.ndarray, rest_vertices: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The order that groups constraints by color, and where each group begins.

    Returns:
        Indices of the constraints, within a color in the given order [C]; offsets: color c
        is order[offsets[c]:offsets[c + 1]] [color_count + 1]; and the class of each constraint
        in the new order: lattice translates share one, -1 means no lattice [C].
    """
    colors, classes = lattice_colors(constraints, rest_vertices)
    colors = complete_colors(constraints, colors, len(rest_vertices))
    colors = np.unique(colors, return_inverse=True)[1].reshape(-1)  # without empty ones
    order = np.argsort(colors, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(np.bincount(colors))]).astype(np.int64)
    return order, offsets, classes[order]


def lattice_colors(constraints, rest_vertices):
    """The lattice's colors and classes of translates; -1 where there is none.  [C], [C] int"""
    colors = np.full(len(constraints), -1)
    classes = colors.copy()
    found = lattice_addresses(rest_vertices)
    if found is None or len(constraints) == 0:
        return colors, classes
    lattice, addresses, on_lattice = found
    regular = on_lattice[constraints].all(axis=1)
    colors[regular], classes[regular] = periodic_classes(lattice, addresses[constraints[regular]])
    # Vertices or constraints at the same place have the same lattice color: drop the later one.
    colored = np.flatnonzero(colors >= 0)
    touched = (colors[colored, None] * len(rest_vertices) + constraints[colored]).ravel()
    order = np.argsort(touched, kind="stable")
    again = order[1:][touched[order[1:]] == touched[order[:-1]]] // constraints.shape[1]
    colors[colored[again]] = -1
    return colors, classes


def complete_colors(constraints, colors, vertex_count):
    """The given colors; each -1 becomes the lowest color that no neighbor has so far.  [C] int"""
    used = [0] * vertex_count  # bit c: a constraint of color c touches this vertex
    missing = np.flatnonzero(colors < 0)
    near = np.zeros(vertex_count, bool)
    near[constraints[missing]] = True
    given = np.flatnonzero((colors >= 0) & near[constraints].any(axis=1))
    order, colors = np.append(given, missing), colors.tolist()
    for constraint, vertices in zip(order.tolist(), constraints[order].tolist(), strict=True):
        if colors[constraint] < 0:
            taken = 0
            for vertex in vertices:
                taken |= used[vertex]
            colors[constraint] = (~taken & (taken + 1)).bit_length() - 1  # the lowest that is free
        for vertex in vertices:
            used[vertex] |= 1 << colors[constraint]
    return np.array(colors)


def lattice_addresses(rest_vertices: np.ndarray) -> tuple[Lattice, np.ndarray, np.ndarray] | None:
    """The lattice that a mesh was cut from, axes along those of space.

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
    """Color and class of constraints by their vertices' addresses [C, n, 3]; translates share them.

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
    keys = np.unique(_keys(lattice, one_period(lattice, vertex_count)))
    return keys, np.array([int(digit, 36) for digit in KNOWN[lattice, vertex_count]])


def one_period(lattice, vertex_count):
    """Addresses of the constraints of one period; an edge is there once for each of its tets."""
    tets = cell_tets(lattice)
    repeats = np.array(list(product(range(0, _period(lattice), lattice.cell_edge), repeat=3)))
    tets = (tets[None] + repeats[:, None, None]).reshape(-1, 4, 3)
    return tets if vertex_count == 4 else tets[:, EDGES].reshape(-1, 2, 3)
