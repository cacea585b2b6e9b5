"""Which tets of A15 hold the volume.

A mesh has about five times as many tets as vertices.  If each tet keeps its volume, a body that
is hardly compressible has hardly any deformation left but bending that is much too stiff: the
mesh locks.  And projecting tets would take two thirds of a substep.  So eight of a cell's 46
tets hold the bulk modulus alone, with the weight of their neighbors' volumes.

Around (0, 0, 0) and (2, 2, 2) of each cell, a tet with the edges L² = 5, 5, 5, 6, 6, 6 lies in
each octant.  Those four hold it in whose octants x y z > 0.

In the infinite lattice the solid stays the same: the eight tets have 3/16 of the cell's volume
and the weight 16/3, so a dilation meets K, and a strain that keeps the volume stores nothing
more.  No vertex leaves its place in the cell, as the pressures around each of them are balanced.
Cutting the mesh leaves tets without such a neighbor, which keep their K.

The others don't resist being turned inside out.  So in parts with an inverted tet all tets hold
their volume for a while (inversion.py).

Shapes: V vertices, T tets.
"""

import numpy as np

from ..geometry import A15, lattice_addresses


def volume_shares(rest_vertices, tets, volumes):
    """The volume for which each tet holds the bulk modulus, over its own.  [T]

    Shares times volumes add up to the mesh's volume.  They are 1 unless the mesh was cut from A15
    with axes along those of space.

    Args:
        volumes: In any unit, positive.  [T]
    """
    holds = holding_tets(rest_vertices, tets)
    # Each other tet gives its volume to its corners, and each corner to the tets that hold.
    count = len(rest_vertices)
    holders = np.bincount(tets[holds].ravel(), minlength=count)
    takes = holders[tets] > 0
    gives = takes.any(axis=1) & ~holds
    parts = np.where(gives, volumes / np.maximum(takes.sum(axis=1), 1), 0.0)[:, None] * takes
    given = np.bincount(tets.ravel(), weights=parts.ravel(), minlength=count)
    taken = (given / np.maximum(holders, 1))[tets].sum(axis=1)
    return np.where(holds, 1.0 + taken / volumes, np.where(gives, 0.0, 1.0))


def holding_tets(rest_vertices, tets):
    """Which tets are of the eight in each cell.  [T] bool"""
    found = lattice_addresses(rest_vertices)
    if found is None or found[0] is not A15:
        return np.zeros(len(tets), bool)
    _, addresses, on_lattice = found
    corners = addresses[tets]
    centers = (corners % A15.cell_edge % 2 == 0).all(axis=2)  # at (0, 0, 0) or (2, 2, 2)
    from_center = corners.sum(axis=1) - 4 * corners[np.arange(len(tets)), centers.argmax(axis=1)]
    # Only of these tets the other corners add up to (±3, ±3, ±3).
    octants = (np.abs(from_center) == 3).all(axis=1) & (from_center.prod(axis=1) > 0)
    return octants & centers.any(axis=1) & on_lattice[tets].all(axis=1)
