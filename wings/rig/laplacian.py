"""Smooth functions on a tet mesh: the Laplacian, and equations with it, in NumPy alone.

The viewer makes weights while a hand waits, and viewing is installed without SciPy.

Shapes: V vertices, T tets, E edges, B functions at once.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...core.geometry import EDGES, TetMesh, edges, signed_volumes

SMALLEST = 1e-2  # of an edge's weight, as a share of the median: see `laplacian`
TOLERANCE = 1e-6  # of weights, which lie between 0 and 1
SETTLED = 1e-5  # the largest step of a weight
MOST_STEPS = 2000


@dataclass(frozen=True)
class Laplacian:
    """Σ_j k_ij (u_i − u_j): an edge list in which each edge appears at both of its ends."""

    ends: np.ndarray  # [2E] the other end j
    conductances: np.ndarray  # [2E] k_ij > 0
    starts: np.ndarray  # [V] where the edges of vertex i begin
    degrees: np.ndarray  # [V] Σ_j k_ij
    volumes: np.ndarray  # [V] a quarter of the incident tets' volumes

    @property
    def counts(self) -> np.ndarray:
        """How many edges each vertex has.  [V]"""
        return np.diff(np.append(self.starts, len(self.ends)))

    def gathered(self, values) -> np.ndarray:
        """Σ_j k_ij u_j.  [V, B]"""
        return np.add.reduceat(self.conductances[:, None] * values[self.ends], self.starts, axis=0)


def laplacian(mesh: TetMesh) -> Laplacian:
    """The stiffness matrix of linear elements: k_ij = −Σ_tets V ∇λ_i·∇λ_j.

    In acute tets, such as those of the A15 lattice, each k is positive, so a solution has no
    maximum inside (it is bounded).  Edges of other tets may have k ≤ 0; they get a small
    positive one instead, which keeps the bound and gives up some accuracy.
    """
    x, tets = mesh.rest_vertices, mesh.tets
    volumes = np.abs(signed_volumes(x, tets))
    matrices = x[tets[:, 1:]] - x[tets[:, :1]]  # rows: edges from corner 0
    gradients = np.empty((len(tets), 4, 3))
    gradients[:, 1:] = np.swapaxes(np.linalg.inv(matrices), 1, 2)
    gradients[:, 0] = -gradients[:, 1:].sum(axis=1)
    products = np.einsum("tei,tei->te", gradients[:, EDGES[:, 0]], gradients[:, EDGES[:, 1]])
    pairs = edges(tets).astype(np.int64)
    keys = pairs[:, 0] * len(x) + pairs[:, 1]
    ordered = np.sort(tets[:, EDGES].reshape(-1, 2), axis=1).astype(np.int64)
    place = np.searchsorted(keys, ordered[:, 0] * len(x) + ordered[:, 1])
    k = -np.bincount(place, (volumes[:, None] * products).ravel(), minlength=len(pairs))
    k = np.maximum(k, SMALLEST * np.median(np.abs(k)))
    both = np.concatenate([pairs, pairs[:, ::-1]])
    order = np.lexsort((both[:, 1], both[:, 0]))
    both, k = both[order], np.tile(k, 2)[order]
    starts = np.searchsorted(both[:, 0], np.arange(len(x)))
    corner_volumes = np.repeat(volumes / 4.0, 4)
    return Laplacian(
        both[:, 1],
        k,
        starts,
        np.bincount(both[:, 0], k, minlength=len(x)),
        np.bincount(tets.ravel(), corner_volumes, minlength=len(x)),
    )


def pulled_at(operator: Laplacian, corners, shares, strength) -> Laplacian:
    """The operator with Σ_p a_p b_pi Σ_c b_pc u_c added: places p that pull, such as samples.

    What a place adds between two corners goes into the conductance of their edge.

    Args:
        corners: Of the tet that each place lies in [N, 4].
        shares: The barycentric coordinates b [N, 4].
        strength: a [N].
    """
    count = len(operator.starts)
    keys = np.repeat(np.arange(count), operator.counts)
    keys = keys * count + operator.ends
    conductances, degrees = operator.conductances, operator.degrees
    for i, j in np.ndindex(4, 4):
        added = strength * shares[:, i] * shares[:, j]
        if i == j:
            degrees = degrees + np.bincount(corners[:, i], added, count)
        else:
            place = np.searchsorted(keys, corners[:, i].astype(np.int64) * count + corners[:, j])
            conductances = conductances - np.bincount(place, added, len(keys))
    return replace(operator, conductances=conductances, degrees=degrees)


def solved(operator: Laplacian, pull, sources, fixed=None, start=None) -> np.ndarray:
    """u with Σ_j k_ij (u_i − u_j) + p_i u_i = s_i.

    Args:
        pull: p ≥ 0 [V].
        sources: s [V, B]; at fixed vertices their values.
        fixed: Which vertices are fixed [V] bool; None: none.
        start: A first guess [V, B]; None: 0.

    Returns:
        [V, B] float64.
    """
    # Conjugate gradients with Jacobi's scaling.
    free = np.ones(len(sources), bool) if fixed is None else ~fixed
    mask, diagonal = free[:, None], (operator.degrees + pull)[:, None]
    u = np.where(mask, 0.0 if start is None else start, sources)
    scaling = np.where(mask, diagonal, 1.0)

    def applied(v):
        return mask * (diagonal * v - operator.gathered(v))

    r = mask * sources - applied(u)
    z = r / scaling
    p = z.copy()
    rho = np.sum(r * z, axis=0)
    size = np.sqrt(np.maximum(rho, 1e-300))
    for _ in range(MOST_STEPS):
        q = applied(p)
        curvature = np.sum(p * q, axis=0)
        step = np.where(curvature > 0.0, rho / np.maximum(curvature, 1e-300), 0.0)
        u += step * p
        r -= step * q
        z = r / scaling
        new = np.sum(r * z, axis=0)
        if (np.sqrt(np.maximum(new, 0.0)) <= TOLERANCE * size).all():
            break
        p = z + np.where(rho > 0.0, new / np.maximum(rho, 1e-300), 0.0) * p
        rho = new
    return u


def solved_as_shares(operator: Laplacian, sources, start) -> np.ndarray:
    """With rows ≥ 0 that sum to 1, the u of least energy ½ u·K u − s·u, K the operator.

    Projected gradients with Nesterov's momentum, which starts again where it leads uphill
    (O'Donoghue and Candès 2015).  K is a sum over tets, of four rows each, so steps of a quarter of
    Jacobi's are short enough.

    Args:
        start: A first guess [V, B]; near the solution without bounds it takes some 50 steps.
    """
    scaling = operator.degrees[:, None]
    u = shares_near(start)
    ahead, momentum = u, 1.0
    for _ in range(MOST_STEPS):
        slope = scaling * ahead - operator.gathered(ahead) - sources
        new = shares_near(ahead - 0.25 * slope / scaling)
        if np.sum((ahead - new) * (new - u) * scaling) > 0.0:
            momentum = 1.0
        following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum * momentum))
        ahead = new + (momentum - 1.0) / following * (new - u)
        u, moved, momentum = new, np.abs(new - u).max(), following
        if moved <= SETTLED:
            break
    return u


def shares_near(values) -> np.ndarray:
    """The nearest rows that are ≥ 0 and sum to 1.  [V, B]"""
    ordered = -np.sort(-values, axis=1)
    excess = np.cumsum(ordered, axis=1) - 1.0
    counts = np.arange(1, values.shape[1] + 1)
    used = (ordered * counts > excess).sum(axis=1)  # of the largest, those that stay above 0
    lowered = excess[np.arange(len(values)), used - 1] / used
    return np.maximum(values - lowered[:, None], 0.0)
