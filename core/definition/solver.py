"""Dynamics: extended position-based dynamics (XPBD), in substeps of one iteration each.

    x, v      [V, 3]   positions [m], velocities [m/s]
    w         [V]      inverse masses [1/kg]; a vertex of w = 0 is held, or taken along a path
    h, δ               length of a substep [s], damping [1/s]
    θ                  the share of a substep at which constraints are projected
    μ, K               shear modulus E / (2 (1 + ν)), and Lamé's λ − μ = μ (4ν − 1) / (1 − 2ν), of a
                       solid with Young's modulus E [Pa] and Poisson's ratio ν ≥ ¼
    V0, V_e            rest volume of a tet, and a sixth of the sum of V0 of an edge's tets [m³]
    C, g_i             a constraint, and its gradients ∂C/∂x_i;   w̄ = Σ w_i |g_i|² at rest
    α, a               its compliance, and the term in place of α/h² in a projection

    edge      C = |x_i − x_j| − L   α = L² / (15 μ V_e) [m/N]   g_i = (x_i − x_j)/|x_i − x_j| = −g_j
    volume    C = 6 (V − V0)        α = 36 V0 / K [m⁵/N]        g_1 = (x_2 − x_0) × (x_3 − x_0), ...

Edges alone are, on average over directions, a solid of ν = ¼; volumes raise ν to the material's.
A substep:

1.  v ← v exp(−δh) + θh gravity, |v| ≤ v_max;   x_θ ← x + θh v, but where w = 0, θ of its way on
2.  Edges, color after color, then volumes, color after color: no two of a color share a vertex.

        Δλ = −C / (Σ w_i |g_i|² + a),   x_i ← x_i + w_i Δλ g_i        (XPBD, Macklin 2016, Eq. 18)
        a = max(α/(θh)² − ½ w̄ − 0.07 w̄² (θh)²/α, f w̄)

    λ starts from 0 in each substep, so it is not kept (Macklin 2019).  A sweep over constraints
    softens each, to first order like a compliance of ½ w̄ (θh)² more; a subtracts that and a term
    of second order.  The factor 0.07 and the floors f were measured: below them, stiff bodies
    tangle.
3.  The substep's end is extrapolated from x_θ, with the mean velocity u = (x_θ − x) / (θh) of that
    share:

        x ← x + h u,   v ← v + (u − v) / θ + (1 − θ) h gravity

    θ = 1 is implicit Euler, whose error in time is of first order in h.  That of θ = ½ would be of
    second order, and no motion would be damped; but a sweep doesn't solve exactly, and needs some.
4.  Contacts (contact.py).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .contact import Contacts, push_apart

SWEEP_SOFTENING, SECOND_SOFTENING = 0.5, 0.07  # what a takes off, in units of the formula above
COLLAPSED = 1e-12  # of L; a shorter edge counts as one of length 0
STEP_LIMIT = 0.5  # of (6 V0)^⅓: how far a volume moves a vertex
TINY = 1e-200  # in place of a length of 0
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])  # of a tet, Bey's m01..m23


@dataclass(frozen=True)
class Constraints:
    """All constraints of one kind, sorted by color."""

    vertices: np.ndarray  # [C, n] int; n = 2 for edges, 4 for tets of positive volume at rest
    rest_values: np.ndarray  # [C] L or 6 V0
    regularization: np.ndarray  # [C] a
    offsets: np.ndarray  # color c is offsets[c]:offsets[c + 1]


@dataclass(frozen=True)
class System:
    """All that a substep needs besides positions and velocities."""

    inverse_masses: np.ndarray  # [V] w
    edges: Constraints
    volumes: Constraints | None  # None at ν = ¼, where K = 0
    substep: float  # h [s]
    decay: float  # exp(−δh)
    gravity: np.ndarray  # [3] m/s²
    speed_limit: float  # v_max [m/s]
    friction: float = 0.0  # Coulomb's coefficient, in contacts
    theta: float = 1.0  # θ


def substep(system: System, x, v, targets, contacts: Contacts | None = None):
    """x and v after a substep.  Vertices of w = 0 are at their targets [V, 3] then."""
    w, before, h, theta = system.inverse_masses, x, system.substep, system.theta
    v = limited(system.decay * v + theta * h * system.gravity, system.speed_limit)
    x = np.where((w > 0)[:, None], x + theta * h * v, x + theta * (targets - x))
    x = project_edges(x, w, system.edges)
    if system.volumes is not None:
        x = project_volumes(x, w, system.volumes)
    x, v = extrapolated(before, x, v, h, theta, system.gravity)
    v = np.where((w > 0.0)[:, None], v, (x - before) / h)
    if contacts is not None:
        x, _, v = push_apart(contacts, x, before, v, w, h, system.friction)
    return x, v


def limited(v, speed_limit):
    """Velocities no faster than the limit.  [V, 3]"""
    speed = np.linalg.norm(v, axis=1, keepdims=True)
    return np.where(speed > speed_limit, speed_limit / np.maximum(speed, TINY), 1.0) * v


def extrapolated(before, x, v, h, theta, gravity):
    """Positions and velocities at a substep's end, given those x at θ of it.  2 × [V, 3]

    Args:
        before: Positions at its beginning.  [V, 3]
        v: Velocities there, and what gravity adds to them until θ.  [V, 3]
    """
    mean = (x - before) / (theta * h)
    return before + h * mean, v + (mean - v) / theta + (1.0 - theta) * h * gravity


def project_edges(x, w, edges: Constraints):
    """Positions after a projection of every edge.

    An edge of length 0 has no direction and takes one that its place in `edges` fixes: a collapsed
    body opens again.
    """
    for first, last in pairwise(edges.offsets):
        i, j = edges.vertices[first:last].T
        rest, a = edges.rest_values[first:last], edges.regularization[first:last]
        length = np.linalg.norm(x[i] - x[j], axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            along = (x[i] - x[j]) / length[:, None]
            multiplier = np.where(w[i] + w[j] > 0, (rest - length) / (w[i] + w[j] + a), 0.0)
        fixed = fixed_directions(np.arange(first, last))
        g = np.where((length > COLLAPSED * rest)[:, None], along, fixed)
        x = x.copy()
        x[i] += w[i, None] * (multiplier[:, None] * g)
        x[j] -= w[j, None] * (multiplier[:, None] * g)
    return x


def fixed_directions(ids):
    """Unit vectors, evenly spread: z and angle are halves of a hash.  [E] int -> [E, 3]"""
    bits = (ids.astype(np.uint32) + np.uint32(1)) * np.uint32(2654435761)
    bits ^= bits >> np.uint32(16)
    bits *= np.uint32(2246822519)
    bits ^= bits >> np.uint32(13)
    z = (bits & np.uint32(0xFFFF)) / 32768.0 - 1.0
    angle = (bits >> np.uint32(16)) * (2.0 * np.pi / 65536.0)
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def project_volumes(x, w, tets: Constraints):
    """Positions after a projection of every tet's volume.

    It moves no vertex farther than STEP_LIMIT (6 V0)^⅓: g is of use near the present shape alone.
    """
    for first, last in pairwise(tets.offsets):
        corners, rest = tets.vertices[first:last], tets.rest_values[first:last]
        g, w_corners = volume_gradients(x, corners), w[corners]
        squared = (g**2).sum(-1)
        total = (w_corners * squared).sum(1) + tets.regularization[first:last]
        with np.errstate(invalid="ignore", divide="ignore"):
            multiplier = -(6.0 * signed_volumes(x, corners) - rest) / total
        multiplier[~(w_corners > 0).any(axis=1)] = 0.0
        longest = np.abs(multiplier) * (w_corners * np.sqrt(squared)).max(1)
        multiplier *= np.minimum(1.0, STEP_LIMIT * np.cbrt(rest) / np.maximum(longest, TINY))
        x = x.copy()
        x[corners] += multiplier[:, None, None] * w_corners[:, :, None] * g
    return x


def signed_volumes(x: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """V of each tet, negative if it is inside out.  [T]"""
    a, b, c, d = (x[tets[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0


def volume_gradients(x, tets):
    """∂(6V)/∂x_i of each tet.  [T, 4, 3]"""
    origin, *others = (x[tets[:, i]] for i in range(4))
    a, b, c = (corner - origin for corner in others)
    outer = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    return np.concatenate([-outer.sum(axis=1, keepdims=True), outer], axis=1)


def inverse_masses(rest, tets, density, held):
    """w: each corner has a quarter of its tets' masses; 0 where held [V] bool.  [V]"""
    quarters = np.repeat(density * signed_volumes(rest, tets) / 4.0, 4)
    masses = np.bincount(tets.ravel(), quarters, len(rest))
    return np.divide(1.0, masses, out=np.zeros_like(masses), where=~held & (masses > 0))


def edge_constraints(rest, tets, shear_modulus, w, reach, floor) -> Constraints:
    """The edges of all tets, for a material of μ; reach is θh."""
    ends = np.sort(tets[:, EDGES].reshape(-1, 2), axis=1)
    ends, edge_of = np.unique(ends, axis=0, return_inverse=True)
    sixths = np.repeat(signed_volumes(rest, tets) / 6.0, 6)
    volumes = np.bincount(edge_of.ravel(), sixths)  # V_e
    lengths = np.linalg.norm(rest[ends[:, 0]] - rest[ends[:, 1]], axis=1)
    compliances = lengths**2 / (15.0 * shear_modulus * volumes)
    return by_color(ends, lengths, regularization(compliances, w[ends].sum(axis=1), reach, floor))


def volume_constraints(rest, tets, k, w, reach, floor) -> Constraints:
    """The volumes of all tets, for a material of K > 0; reach is θh."""
    volumes = 6.0 * signed_volumes(rest, tets)
    w_bar = (w[tets] * (volume_gradients(rest, tets) ** 2).sum(-1)).sum(axis=1)
    return by_color(tets, volumes, regularization(6.0 * volumes / k, w_bar, reach, floor))


def regularization(compliances, w_bar, reach, floor):
    """a of constraints with compliances α and w̄; reach is θh.  [C]"""
    taken_off = SWEEP_SOFTENING * w_bar + SECOND_SOFTENING * (w_bar * reach) ** 2 / compliances
    return np.maximum(compliances / reach**2 - taken_off, floor * w_bar)


def by_color(vertices, rest_values, a) -> Constraints:
    """Constraints in order: each takes the lowest color that none of its vertices has yet."""
    used = [set() for _ in range(vertices.max() + 1)]  # colors at each vertex
    colors = []
    for ids in vertices.tolist():
        taken = set().union(*(used[i] for i in ids))
        colors.append(next(color for color in range(len(taken) + 1) if color not in taken))
        for i in ids:
            used[i].add(colors[-1])
    order, offsets = np.argsort(colors, kind="stable"), np.cumsum([0, *np.bincount(colors)])
    return Constraints(vertices[order], rest_values[order], a[order], offsets)
