"""How much stiffer or softer each class of a lattice's edges is, so that no direction is.

Springs with k_e = 15 μ V_e / L² on every edge are an isotropic solid of λ = μ only on
average over directions.  A lattice has few directions: with shears ε_xx − ε_yy held
against shears ε_xy, A15 is 0.777, BCC 1.333 and Kuhn's lattice 0.476 times as stiff
(Zener's ratio).  So every class of equally long edges gets a factor, k_e = 15 μ f V_e / L².

In the infinite lattice under a strain ε each edge e, with unit vector n and V_e around it,
stores ½ k_e (n·ε n L)².  The factors follow from two linear systems over one cell of
volume V,

    1/V Σ k_e L² n_i n_j n_k n_l = μ (δ_ij δ_kl + δ_ik δ_jl + δ_il δ_jk)
    Σ_{e at vertex a} ± k_e L n_i n_j n_k = 0          for every vertex a of the cell

The second says that no strain moves a vertex off its place in the cell, or it would
soften shears alone: A15's vertices aren't all centers of symmetry.  It also keeps volume
constraints, which leave vertices in place, exact.

    A15   L² 4 : 5 : 6   f = 4/25, 8/7, 192/175
    BCC   L² 3 : 4       f = 9/10, 6/5
    Kuhn  L² 1 : 2 : 3   no solution; f = 1

The tables are what the tests find; nothing here has them typed in.
Shapes: E edges of a mesh, P edges of a cell, C classes.
"""

from functools import cache

import numpy as np

from ..geometry import A15, BCC, EDGES, KUHN, Lattice, cell_tets, signed_volumes

LENGTH_TOLERANCE = 1e-3  # of L²; classes are 20 % apart, float32 vertices 1e-5 of an edge
LATTICE_SHARE = 0.5  # of a mesh's edges must be the lattice's


def edge_factors(rest_lengths):
    """f of each edge of a mesh that was cut from a lattice; 1 where there is no class.  [E]

    Lengths alone tell the lattice, so the mesh may be trimmed, scaled and turned.
    """
    found = recognize(rest_lengths)
    factors = np.ones(len(rest_lengths))
    if found is not None:
        lattice, classes = found
        table = lattice_factors(lattice)
        factors[classes >= 0] = table[classes[classes >= 0]]
    return factors


def recognize(rest_lengths):
    """The lattice that a mesh's edges are from, and the class of each edge.

    Returns:
        The lattice and an index into its squared_lengths, −1 for other edges [E]; None if
        fewer than half of the edges have the lengths of one lattice.
    """
    squared = np.asarray(rest_lengths, np.float64) ** 2
    if len(squared) == 0 or not (squared > 0).any():
        return None
    positive = squared[squared > 0]
    bins, counts = np.unique(np.rint(np.log(positive) / LENGTH_TOLERANCE), return_counts=True)
    commonest = np.exp(LENGTH_TOLERANCE * bins[counts.argmax()])
    commonest = np.median(positive[np.abs(positive / commonest - 1) < LENGTH_TOLERANCE])
    best, best_share = None, LATTICE_SHARE
    for lattice in (A15, BCC, KUHN):
        expected = np.array(lattice.squared_lengths)
        for unit in commonest / expected:
            close = np.abs(squared[:, None] / (unit * expected) - 1) < LENGTH_TOLERANCE
            share = close.any(axis=1).mean()
            if share > best_share and close.any(axis=0).all():
                best = lattice, np.where(close.any(axis=1), close.argmax(axis=1), -1)
                best_share = share
    return best


@cache
def lattice_factors(lattice: Lattice):
    """f of each of a lattice's squared_lengths; all 1 if none make it isotropic.  [C]"""
    _, steps, volumes, classes = cell_edges(lattice)
    tensor, forces = stiffness_rows(lattice)
    wanted = np.zeros((3,) * 4)
    for i, j in np.ndindex(3, 3):
        wanted[i, i, j, j] += 1
        wanted[i, j, i, j] += 1
        wanted[i, j, j, i] += 1
    per_class = np.zeros((len(steps), len(lattice.squared_lengths)))
    per_class[np.arange(len(steps)), classes] = 15.0 * volumes / (steps**2).sum(axis=1)
    rows = np.concatenate([tensor, forces]) @ per_class
    right = np.concatenate([wanted.ravel(), np.zeros(len(forces))])
    factors = np.linalg.lstsq(rows, right, rcond=None)[0]
    if np.abs(rows @ factors - right).max() > 1e-9 or factors.min() <= 0:
        return np.ones(len(factors))
    return factors


def cell_edges(lattice: Lattice):
    """The edges of one cell of the infinite lattice, each once.

    Returns:
        The cell's vertices at their ends [P, 2], the ways from one to the other [P, 3],
        V_e [P], and which of squared_lengths they have [P].
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


def stiffness_rows(lattice: Lattice):
    """What a unit of k_e adds to the cell's stiffness and to the forces on its vertices.

    Returns:
        L² n_i n_j n_k n_l / V [81, P] and ± L n_i n_j n_k / cell edge² for each vertex
        [27 · vertices, P].
    """
    ends, steps, _, _ = cell_edges(lattice)
    lengths = np.linalg.norm(steps, axis=1)
    n = steps / lengths[:, None]
    third = np.einsum("p,pi,pj,pk->pijk", lengths, n, n, n)
    tensor = np.einsum("p,pijk,pl->ijklp", lengths, third, n) / lattice.cell_edge**3
    forces = np.zeros((len(lattice.cell_vertices), len(steps), 27))
    each = np.arange(len(steps))
    np.add.at(forces, (ends[:, 0], each), third.reshape(-1, 27))
    np.add.at(forces, (ends[:, 1], each), -third.reshape(-1, 27))
    forces = np.swapaxes(forces, 1, 2).reshape(-1, len(steps)) / lattice.cell_edge**2
    return tensor.reshape(81, -1), forces
