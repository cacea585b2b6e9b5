"""Factors that make a lattice of springs equally stiff in all directions.

Springs with k_e = 15 μ V_e / L² on every edge are an isotropic solid of λ = μ only on
average over directions.  A lattice has few directions.  Zener's ratio compares its stiffness
against shears ε_xx − ε_yy with that against shears ε_xy: it is 0.777 for A15, 1.333 for BCC and
0.476 for Kuhn's lattice.  So every class of equally long edges gets a factor,
k_e = 15 μ f V_e / L².

In the infinite lattice under a strain ε each edge e, with unit vector n and V_e around it,
stores ½ k_e (n·ε n L)².  The factors follow from two linear systems over one cell of
volume V,

    1/V Σ k_e L² n_i n_j n_k n_l = μ (δ_ij δ_kl + δ_ik δ_jl + δ_il δ_jk)
    Σ_{e at vertex a} ± k_e L n_i n_j n_k = 0          for every vertex a of the cell

The second system says that no strain moves a vertex from its place in the cell.  Otherwise
such moves would soften shears, because not all vertices of A15 are centers of symmetry.
Volume constraints do not move these vertices either, so they stay exact.

    A15   L² 4 : 5 : 6   f = 4/25, 8/7, 192/175
    BCC   L² 3 : 4       f = 9/10, 6/5
    Kuhn  L² 1 : 2 : 3   no solution; f = 1

The code derives this table, and a test compares it.
Shapes: E edges of a mesh, P edges of a cell, C classes.
"""

from functools import cache

import numpy as np

from ..geometry import A15, BCC, EDGES, KUHN, Lattice, cell_tets, signed_volumes

LENGTH_TOLERANCE = 1e-3  # of L²; classes are 20 % apart, float32 vertices 1e-5 of an edge
LATTICE_SHARE = 0.5  # of a mesh's edges must have the lengths of one lattice


def edge_factors(rest_lengths):
    """f of each edge of a mesh that was cut from a lattice; 1 for edges of no class.  [E]

    The lengths identify the lattice, so the mesh may be trimmed, scaled and turned.
    """
    squared = np.asarray(rest_lengths, np.float64) ** 2
    factors, best_share = np.ones(len(squared)), LATTICE_SHARE
    positive = squared[squared > 0]
    if len(positive) == 0:
        return factors
    bins, counts = np.unique(np.rint(np.log(positive) / LENGTH_TOLERANCE), return_counts=True)
    commonest = np.exp(LENGTH_TOLERANCE * bins[counts.argmax()])
    commonest = np.median(positive[np.abs(positive / commonest - 1) < LENGTH_TOLERANCE])
    for lattice in (A15, BCC, KUHN):
        expected = np.array(lattice.squared_lengths)
        for unit in commonest / expected:
            close = np.abs(squared[:, None] / (unit * expected) - 1) < LENGTH_TOLERANCE
            known = close.any(axis=1)
            if known.mean() > best_share and close.any(axis=0).all():
                best_share = known.mean()
                factors = np.where(known, lattice_factors(lattice)[close.argmax(axis=1)], 1.0)
    return factors


@cache
def lattice_factors(lattice: Lattice):
    """f of each of a lattice's squared_lengths; all 1 if none make it isotropic.  [C]"""
    ends, steps, volumes, classes = cell_edges(lattice)
    lengths, each = np.linalg.norm(steps, axis=1), np.arange(len(steps))
    n = steps / lengths[:, None]
    # What a unit of k_e adds to the cell's stiffness, L² n_i n_j n_k n_l / V [81, P], and to
    # the forces on its vertices, ± L n_i n_j n_k / cell edge² [27 · vertices, P].
    third = np.einsum("p,pi,pj,pk->pijk", lengths, n, n, n)
    tensor = np.einsum("p,pijk,pl->ijklp", lengths, third, n) / lattice.cell_edge**3
    forces = np.zeros((len(lattice.cell_vertices), len(steps), 27))
    np.add.at(forces, (ends[:, 0], each), third.reshape(-1, 27))
    np.add.at(forces, (ends[:, 1], each), -third.reshape(-1, 27))
    forces = np.swapaxes(forces, 1, 2).reshape(-1, len(steps)) / lattice.cell_edge**2
    delta = np.eye(3)
    wanted = sum(np.einsum(f"{pairs}->ijkl", delta, delta) for pairs in ("ij,kl", "ik,jl", "il,jk"))
    per_class = np.zeros((len(steps), len(lattice.squared_lengths)))
    per_class[each, classes] = 15.0 * volumes / (steps**2).sum(axis=1)
    rows = np.concatenate([tensor.reshape(81, -1), forces]) @ per_class
    right = np.concatenate([wanted.ravel(), np.zeros(len(forces))])
    factors = np.linalg.lstsq(rows, right, rcond=None)[0]
    if np.abs(rows @ factors - right).max() > 1e-9 or factors.min() <= 0:
        return np.ones(len(factors))
    return factors


def cell_edges(lattice: Lattice):
    """The edges of one cell of the infinite lattice, each once.

    Returns:
        Ids of the cell's vertices at their ends [P, 2], vectors from one end to the other
        [P, 3], V_e [P], and indices into squared_lengths [P].
    """
    corners = cell_tets(lattice)
    shares = signed_volumes(corners.reshape(-1, 3), np.arange(corners[..., 0].size).reshape(-1, 4))
    vertex_ids = {place: i for i, place in enumerate(lattice.cell_vertices)}
    volumes = {}
    for tet, share in zip(corners, shares / 6.0, strict=True):
        for ends in tet[EDGES].tolist():
            low, high = (np.array(end) for end in sorted(ends))
            first, second = (vertex_ids[tuple(end % lattice.cell_edge)] for end in (low, high))
            key = (first, second, *(high - low).tolist())
            volumes[key] = volumes.get(key, 0.0) + share
    table = np.array(list(volumes))
    squared = (table[:, 2:] ** 2).sum(axis=1)
    classes = np.searchsorted(lattice.squared_lengths, squared)
    return table[:, :2], table[:, 2:].astype(float), np.array(list(volumes.values())), classes
