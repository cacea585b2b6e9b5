"""Factors that make a lattice of springs equally stiff in all directions.

Springs with k_e = 15 μ V_e / L² on every edge are an isotropic solid of λ = μ only on
average over directions.  A lattice has few directions.  Zener's ratio compares its stiffness
against shears ε_xx − ε_yy with that against shears ε_xy: it is 0.777 for A15, 1.333 for BCC and
0.476 for Kuhn's lattice.  So every class of equally long edges gets a factor,
k_e = 15 μ f V_e / L².

V_e is a sixth of the volume of the tets around an edge e, and n the edge's unit vector.  In the
infinite lattice under a strain ε, each edge stores ½ k_e (n·ε n L)².  The factors follow from two
linear systems over one cell of volume V,

    1/V Σ k_e L² n_i n_j n_k n_l = μ (δ_ij δ_kl + δ_ik δ_jl + δ_il δ_jk)
    Σ_{e at vertex a} ± k_e L n_i n_j n_k = 0          for every vertex a of the cell

The second system says that no strain moves a vertex from its place in the cell.  Otherwise
such moves would soften shears, because not all vertices of A15 are centers of symmetry.
Volume constraints do not move vertices within the cell either, so they add exactly their
modulus K to λ.  For Kuhn's lattice there is no solution.

A thin sheet of A15 is another lattice, with other factors for the edges between vertices of its
surface: f^(1 − w) s^w, with s of SHEET_FACTORS and the weight w of thin.py.  They are fitted to
the bending, stretching and twisting of endless sheets of 1 to 2.5 cells, cut in five directions
and at all heights, as quadratic finite elements on the same tets have them.  From there sheets.py
fits each sheet of up to 2.5 cells.

Shapes: E edges of a mesh.
"""

import numpy as np

from ..geometry import A15, BCC, KUHN

# f of each of a lattice's squared_lengths.
FACTORS = {A15: (4 / 25, 8 / 7, 192 / 175), BCC: (9 / 10, 6 / 5), KUHN: (1.0, 1.0, 1.0)}
SHEET_FACTORS = FACTORS | {A15: (3 / 5, 5 / 8, 1.0)}  # s
LENGTH_TOLERANCE = 1e-3  # of L²; classes are 20 % apart, float32 vertices 1e-5 of an edge
LATTICE_SHARE = 0.5  # of a mesh's edges must have the lengths of one lattice


def edge_factors(rest_lengths, of_lattices=FACTORS):
    """The factor of each edge of a mesh that was cut from a lattice; 1 for edges of no class.  [E]

    The lengths identify the lattice, so the mesh may be trimmed, scaled and turned.

    Args:
        of_lattices: FACTORS or SHEET_FACTORS.
    """
    squared = np.asarray(rest_lengths, np.float64) ** 2
    factors, best_share = np.ones(len(squared)), LATTICE_SHARE
    positive = squared[squared > 0]
    if len(positive) == 0:
        return factors
    bins, counts = np.unique(np.rint(np.log(positive) / LENGTH_TOLERANCE), return_counts=True)
    commonest = np.exp(LENGTH_TOLERANCE * bins[counts.argmax()])
    commonest = np.median(positive[np.abs(positive / commonest - 1) < LENGTH_TOLERANCE])
    for lattice, of_classes in of_lattices.items():
        expected = np.array(lattice.squared_lengths)
        for unit in commonest / expected:
            close = np.abs(squared[:, None] / (unit * expected) - 1) < LENGTH_TOLERANCE
            known = close.any(axis=1)
            if known.mean() > best_share and close.any(axis=0).all():
                best_share = known.mean()
                factors = np.where(known, np.take(of_classes, close.argmax(axis=1)), 1.0)
    return factors
