"""Choose the tets of A15 that keep their volume.

A mesh has about five times as many tets as vertices.  If each tet of a nearly incompressible body
keeps its volume, the body can hardly do anything but bend, and is much too stiff in that: the
mesh locks.  Also, projecting all tets would take two thirds of a substep.  So only eight of a
cell's 46 tets have a bulk modulus, and each of them stands for the volumes of its neighbors, too.

Around the points (0, 0, 0) and (2, 2, 2) of each cell, a tet with the squared edge lengths 5, 5, 5,
6, 6, 6 lies in each octant.  At each point, the four in the octants with x y z > 0 are chosen.

In the infinite lattice this does not change the solid.  The eight tets have 3/16 of the cell's
volume and the weight 16/3, so the bulk modulus is K; a strain that keeps the volume stores no
extra energy.  No vertex moves from its place in the cell: the pressures around it balance.
A tet at the mesh's boundary may have no chosen neighbor; it keeps its own K.

In parts with an inverted tet, all tets keep their volume for a while (inversion.py).

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
    shares = np.where(gives, volumes / np.maximum(takes.sum(axis=1), 1), 0.0)[:, None] * takes
    given = np.bincount(tets.ravel(), weights=shares.ravel(), minlength=count)
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
