"""The A15 tetrahedral lattice that covers the unit cube.

A cell of edge 4·dx holds 8 vertices and 46 tets; every vertex is an integer multiple of
dx, every edge has length² in {4, 5, 6}·dx², no dihedral angle exceeds 78.5° (the acute
tiling that QuarTet uses; DeformRF, section 4.1, takes dx = 0.02).

The tets are not typed in: they are the 4-cliques of the graph that joins vertices at
those three distances, which in a tetrahedrally close-packed structure are the Delaunay
cells.
"""

from itertools import product

import numpy as np

from .corner_order import best_corner_order
from .mesh import TetMesh

CELL_EDGE = 4  # in units of dx
CELL_VERTICES = np.array(
    [[0, 0, 0], [2, 2, 2], [1, 2, 0], [3, 2, 0], [0, 1, 2], [0, 3, 2], [2, 0, 1], [2, 0, 3]]
)  # [8, 3], in units of dx
EDGE_LENGTHS_SQUARED = (4, 5, 6)  # in units of dx²


def _cell_tets():
    """The 46 tets of one cell and its translates, as corner positions.  [46, 4, 3] int

    A tet belongs to the cell that holds its lexicographically lowest vertex.  Corners are
    in the order that is best for the shapes of the descendants, volumes positive.
    """
    offsets = np.array(list(product((-1, 0, 1), repeat=3))) * CELL_EDGE
    points = (CELL_VERTICES[None] + offsets[:, None]).reshape(-1, 3)
    order = np.lexsort(points.T[::-1])
    points = points[order]
    squared = ((points[:, None] - points[None]) ** 2).sum(-1)
    joined = np.isin(squared, EDGE_LENGTHS_SQUARED)
    later = joined & (np.arange(len(points))[:, None] < np.arange(len(points)))
    in_cell = ((points >= 0) & (points < CELL_EDGE)).all(axis=1)
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


def morton_order(points):
    """Indices that sort integer points [N, 3] (0 <= x < 1024) along a Z-curve."""
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((points[:, axis].astype(np.int64) >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def a15_grid(spacing: float) -> TetMesh:
    """The tets of the A15 lattice that meet the unit cube, uncut.

    Args:
        spacing: dx, in (0, 1/4]; the cube's edge is 1.  Edges are 2 to 2.45 dx long.

    Returns:
        A mesh that covers the cube; its addresses are non-negative and sorted along a
        space-filling curve, so neighbours lie close in memory.

    Raises:
        ValueError: spacing is outside (0, 1/4].
    """
    if not 0.0 < spacing <= 0.25:
        raise ValueError(f"the lattice spacing is {spacing}; give a number in (0, 0.25]")
    cell_count = int(np.ceil(1.0 / (CELL_EDGE * spacing) - 1e-9)) + 2
    cells = np.array(list(product(range(cell_count), repeat=3))) * CELL_EDGE
    tets = (cells[:, None, None] + _cell_tets()[None]).reshape(-1, 4, 3)

    # One cell of margin below the cube keeps every address non-negative.
    low, high = CELL_EDGE, CELL_EDGE + 1.0 / spacing
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


def lattice_vertices(addresses, spacing: float):
    """Where the vertices of these addresses are.  [V, 3] int -> [V, 3] float64"""
    return (addresses - CELL_EDGE) * float(spacing)  # the margin below the cube


def lattice_spacing(mesh: TetMesh) -> float | None:
    """The dx with which `lattice_vertices` gives the mesh's rest vertices, bit for bit."""
    multiples = mesh.addresses - CELL_EDGE
    ratios = mesh.rest_vertices[multiples != 0] / multiples[multiples != 0]
    # A product and a quotient are rounded: the ratios of a lattice are a few neighbours.
    if len(ratios) == 0 or np.ptp(ratios) > 4 * np.spacing(np.abs(ratios).max()):
        return None
    for spacing in np.unique(ratios):
        if np.array_equal(lattice_vertices(mesh.addresses, spacing), mesh.rest_vertices):
            return float(spacing)
    return None
