"""Tetrahedral lattices that cover the unit cube: A15, BCC and Kuhn's.

    lattice  cell edge  vertices  tets   length² of edges   dihedral angles
    A15      4 dx       8         46     4, 5, 6 dx²        up to 78.5°
    BCC      2 dx       2         12     3, 4 dx²           60° and 90°
    Kuhn     1 dx       1         6      1, 2, 3 dx²        45° to 90°

Every vertex is an integer multiple of dx.  Training uses A15, the acute tiling of QuarTet; tests
compare the others with it.

Tets are the 4-cliques of the graph that joins vertices at the distances above.  For tetrahedrally
close-packed structures (A15) and BCC these cliques are the Delaunay cells.  In Kuhn's graph the
difference of two joined vertices has components >= 0 only, or <= 0 only.  So the vertices of a
clique form a path through a cube along which no coordinate decreases.

The order of a tet's corners determines the shapes of its descendants (subdivision.py).  Let a, b,
c, d be the steps of the closed path v0 v1 v2 v3 v0.  Every descendant has the same four steps,
scaled, in one of three cyclic orders.  A descendant's other two edges are, scaled, two of three
vectors: p = a + b from v0 to v2, q = b + c from v1 to v3, and r = a + c.  Half of r leads from the
middle of the edge v0v2 to that of v1v3.  With
S = |a|² + |b|² + |c|² + |d|² = |p|² + |q|² + |r|², the squared edges of the three shapes sum to
2S - |p|², 2S - |q|² and 2S - |r|².  All tets of a level have equal volume, so these sums alone rank
the shapes by their mean ratio,

    12 (3 volume)^(2/3) / sum of squared edge lengths,           1 for a regular tet.

The sums depend only on which two opposite edges are v0v2 and v1v3.  A tet has three such pairs, so
the 24 orders give three results.  Even permutations, which keep the orientation, give all three.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from ..definition.lattice import MARGIN, PERIOD, PERIOD_VERTICES, SQUARED_EDGES
from .mesh import EDGES, TetMesh


@dataclass(frozen=True)
class Lattice:
    """One cell of a lattice and the rule for its edges, in units of dx."""

    cell_edge: int  # a whole divisor of MARGIN
    cell_vertices: tuple[tuple[int, int, int], ...]  # [C, 3]
    squared_lengths: tuple[int, ...]  # of edges
    monotone: bool = False  # whether no edge rises along one axis and falls along another


A15 = Lattice(PERIOD, tuple(map(tuple, PERIOD_VERTICES.tolist())), SQUARED_EDGES)
BCC = Lattice(2, ((0, 0, 0), (1, 1, 1)), (3, 4))
KUHN = Lattice(1, ((0, 0, 0),), (1, 2, 3), monotone=True)
ORDERS = np.array([[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2]])  # of corners, even permutations
CROSSING_EDGES = np.array([[1, 4], [2, 3], [0, 5]])  # v0v2 and v1v3 of each, rows of EDGES


def cell_tets(lattice: Lattice) -> np.ndarray:
    """The tets of one cell and its translates, as corner positions.  [T, 4, 3] int

    A tet belongs to the cell that holds its lexicographically lowest vertex.  Corners are
    in the order that is best for the shapes of the descendants, volumes positive.
    """
    offsets = np.array(list(product((-1, 0, 1), repeat=3))) * lattice.cell_edge
    points = (np.array(lattice.cell_vertices)[None] + offsets[:, None]).reshape(-1, 3)
    order = np.lexsort(points.T[::-1])
    points = points[order]
    steps = points[:, None] - points[None]
    joined = np.isin((steps**2).sum(-1), lattice.squared_lengths)
    if lattice.monotone:
        joined &= (steps >= 0).all(-1) | (steps <= 0).all(-1)
    later = joined & (np.arange(len(points))[:, None] < np.arange(len(points)))
    in_cell = ((points >= 0) & (points < lattice.cell_edge)).all(axis=1)
    tets = [
        (a, b, c, d)
        for a in np.flatnonzero(in_cell)
        for b in np.flatnonzero(later[a])
        for c in np.flatnonzero(later[a] & later[b])
        for d in np.flatnonzero(later[a] & later[b] & later[c])
    ]
    corners = points[np.array(tets)]
    inverted = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    corners[inverted] = corners[inverted][:, [0, 1, 3, 2]]
    return np.take_along_axis(corners, best_corner_order(corners)[..., None], axis=1)


def best_corner_order(corners):
    """The corner order whose worst descendant is best, then best on average.

    Args:
        corners: Corner positions, exact if they are integers.  [T, 4, 3]

    Returns:
        An even permutation of each tet's corners; of equally good ones the first.  [T, 4]
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


def morton_order(points: np.ndarray) -> np.ndarray:
    """Indices that sort integer points [N, 3] (0 <= x < 1024) along a Z-curve."""
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((points[:, axis].astype(np.int64) >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def a15_grid(spacing: float) -> TetMesh:
    """The tets of the A15 lattice that meet the unit cube; edges are 2 to 2.45 dx long."""
    return grid(A15, spacing)


def grid(lattice: Lattice, spacing: float) -> TetMesh:
    """The tets of a lattice that meet the unit cube, uncut.

    Args:
        spacing: dx; a cell may be as wide as the unit cube.

    Returns:
        A mesh that covers the cube.  Its addresses are non-negative and sorted along a
        space-filling curve, so that neighbors are close in memory.

    Raises:
        ValueError: spacing is not positive, or a cell is wider than the cube.
    """
    edge = lattice.cell_edge
    if not 0.0 < spacing <= 1.0 / edge:
        raise ValueError(f"the lattice spacing is {spacing}; give a number in (0, {1 / edge}]")
    cell_count = int(np.ceil(1.0 / (edge * spacing) - 1e-9)) + 2
    # One cell of margin below the cube keeps every address non-negative.
    cells = np.array(list(product(range(cell_count), repeat=3))) * edge + (MARGIN - edge)
    tets = (cells[:, None, None] + cell_tets(lattice)[None]).reshape(-1, 4, 3)

    low, high = MARGIN, MARGIN + 1.0 / spacing
    meets = ((tets.max(axis=1) > low + 1e-9) & (tets.min(axis=1) < high - 1e-9)).all(axis=1)
    tets = tets[meets]
    tets = tets[morton_order(tets.sum(axis=1) // 4)]

    addresses, ids = np.unique(tets.reshape(-1, 3), axis=0, return_inverse=True)
    order = morton_order(addresses)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    addresses, ids = addresses[order], rank[ids.reshape(-1, 4)]
    return TetMesh(
        rest_vertices=lattice_vertices(addresses, spacing),
        addresses=addresses.astype(np.int32),
        tets=ids.astype(np.int32),
    )


def lattice_vertices(addresses: np.ndarray, spacing: float) -> np.ndarray:
    """Rest positions of vertices with these addresses.  [V, 3] int -> [V, 3] float64"""
    return (addresses - MARGIN) * float(spacing)


def lattice_spacing(mesh: TetMesh) -> float | None:
    """The dx with which `lattice_vertices` gives the mesh's rest vertices, bit for bit."""
    multiples = mesh.addresses - MARGIN
    ratios = mesh.rest_vertices[multiples != 0] / multiples[multiples != 0]
    # Product and quotient are rounded, so a lattice has a few ratios, next to each other.
    if len(ratios) == 0 or np.ptp(ratios) > 4 * np.spacing(np.abs(ratios).max()):
        return None
    for spacing in np.unique(ratios):
        if np.array_equal(lattice_vertices(mesh.addresses, spacing), mesh.rest_vertices):
            return float(spacing)
    return None
