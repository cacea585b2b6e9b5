"""Float64 references for the solver: where an elastic body rests, and how it moves.

Rest: Newton's method minimizes Π(x) = energy(x) − f · x over the free vertices.  A step is
(∂²Π + s I)⁻¹ (−∂Π), with the least shift s ≥ 0 tried that makes the matrix positive definite; a
line search keeps Π falling (Armijo).  A factorization serves until a step leaves more than
a tenth of the residual.

Motion: velocity Verlet, second order in h and symplectic; held vertices stay.

    v ← v + h/2 a(x),   x ← x + h v,   v ← v + h/2 a(x),   a = g − ∂energy/∂x / m

Shapes: V vertices, F free ones.
"""

import math

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import eigsh, splu

from .energy import Energy

ENOUGH_PROGRESS = 0.1  # of the residual may be left by a step with old factors
ARMIJO = 1e-4
COURANT = 0.2  # of the longest stable step, 2/ω_max


class NoEquilibrium(RuntimeError):
    """Newton's method does not converge."""


def equilibrium(energy: Energy, start, held, gravity, tolerance=1e-10, most_steps=100):
    """The rest pose of a body under gravity, with some vertices held at their `start`.

    Args:
        start: [V, 3] m; handles at their targets.
        held: [V] bool
        gravity: [3] m/s²
        tolerance: Bound of the residual, or float64's rounding error if that is larger.

    Returns:
        Vertices [V, 3], and the residual: the norm of the forces on free vertices over that
        of the loads and reactions.

    Raises:
        NoEquilibrium: Newton's method does not converge.
    """
    x = np.array(start, np.float64)
    dofs = free_dofs(held)
    loads = energy.masses[:, None] * np.array(gravity)
    factors, before = None, 0.0
    for _ in range(most_steps + 1):
        forces = (loads - energy.gradient(x)).ravel()
        scale = max(np.linalg.norm(forces), np.linalg.norm(loads))
        residual = np.linalg.norm(forces[dofs])
        rounded = np.linalg.norm(energy.stiffnesses) * np.abs(x).max() * np.finfo(float).eps
        if residual <= max(tolerance * scale, rounded):
            return x, float(residual / scale) if scale > 0 else 0.0
        if residual > ENOUGH_PROGRESS * before:
            factors = _positive_factors(energy.hessian(x)[dofs][:, dofs])
        step = np.zeros(x.size)
        step[dofs] = factors.solve(forces[dofs])
        x = _line_search(energy, loads, x, step.reshape(-1, 3), forces @ step)
        before = residual
    raise NoEquilibrium(
        f"no equilibrium after {most_steps} Newton steps: a residual of {residual / scale:.1e}"
    )


def free_dofs(held):
    """Rows of the Hessian that belong to free vertices.  [3F]"""
    return (3 * np.flatnonzero(~np.asarray(held))[:, None] + np.arange(3)).ravel()


def factorize(matrix):
    """LU without pivoting, which is LDLᵀ; None unless every pivot is positive."""
    ordering = {"permc_spec": "MMD_AT_PLUS_A", "options": {"SymmetricMode": True}}
    try:
        factors = splu(matrix.tocsc(), diag_pivot_thresh=0.0, **ordering)
    except RuntimeError:  # a pivot of exactly 0
        return None
    return factors if factors.U.diagonal().min() > 0 else None


def _positive_factors(hessian):
    """Factors of hessian + s I, for the least s ≥ 0 tried that makes it positive definite."""
    shift = 0.0
    while (factors := factorize(hessian + shift * sparse.eye_array(hessian.shape[0]))) is None:
        shift = max(10.0 * shift, 1e-4 * abs(hessian).max())
    return factors


def _line_search(energy, loads, x, step, slope):
    """x + t·step with the first t = 1, ½, ¼, … that lowers Π enough."""

    def potential(x):
        return energy.value(x) - float((loads * x).sum())

    before = potential(x)
    slack = 1e-12 * abs(before)
    for t in 0.5 ** np.arange(40):
        if potential(x + t * step) <= before - ARMIJO * t * slope + slack:
            break
    return x + t * step


def motion(energy: Energy, rest, held, gravity, duration, samples):
    """The undamped motion of a body from rest, for a duration [s].

    Returns:
        Positions at the end of each of so many equal spans [samples, V, 3], and their own
        RMS error [m]: as the order is 2, a third of the difference to a run with 2h.
    """
    step = COURANT * longest_step(energy, rest, held)
    count = 2 * samples * math.ceil(duration / step / (2 * samples))
    coarse, fine = (
        verlet(energy, rest, held, gravity, duration, steps, samples)[0]
        for steps in (count // 2, count)
    )
    return fine, float(np.sqrt(((fine - coarse) ** 2).sum(axis=2).mean())) / 3.0


def verlet(energy: Energy, start, held, gravity, duration, count, samples):
    """`count` steps: positions on the way [samples, V, 3], velocities at the end [V, 3]."""
    h = duration / count
    mobility = (~np.asarray(held) / energy.masses)[:, None]
    push = np.where(mobility > 0.0, gravity, 0.0)
    x, v, path = np.array(start, np.float64), np.zeros_like(start, np.float64), []
    kick = 0.5 * h * (push - mobility * energy.gradient(x))
    for step in range(1, count + 1):
        v = v + kick
        x = x + h * v
        kick = 0.5 * h * (push - mobility * energy.gradient(x))
        v = v + kick
        if step % (count // samples) == 0:
            path.append(x)
    return np.array(path), v


def longest_step(energy: Energy, x, held):
    """The longest stable step 2/ω_max [s] about x."""
    scale = sparse.diags_array(np.repeat(np.where(held, 0.0, 1.0 / np.sqrt(energy.masses)), 3))
    start = np.random.default_rng(0).normal(size=scale.shape[0])
    matrix = scale @ energy.hessian(np.asarray(x, np.float64)) @ scale
    return 2.0 / math.sqrt(eigsh(matrix, 1, v0=start, tol=1e-3, return_eigenvectors=False)[0])
