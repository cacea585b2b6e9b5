"""Where an elastic body comes to rest: Newton's method with the exact Hessian.

Minimizes Π(x) = energy(x) − f · x over the free vertices.  A step solves (∂²Π + s I) p = −∂Π
by conjugate gradients, preconditioned by a sparse factorization of an earlier Hessian; both
are renewed when that gets slow.  The shift s is 0 unless the Hessian has a direction of
negative curvature.  A line search keeps Π falling (Armijo).

The factorization eliminates vertices in the order of a nested dissection by position: a
beam of 94k tets takes 10 s and 30 million numbers, ordered along its axis 24 s and 46 million
(measured).

Shapes: V vertices, F free ones.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from .energy import Energy

LEAF = 100  # vertices that are no longer dissected
CG_TOLERANCE = 1e-6  # of a Newton step's residual
CG_ITERATIONS = 40  # then the preconditioner is too old
ARMIJO = 1e-4


@dataclass(frozen=True)
class Equilibrium:
    """Attributes:
    vertices: [V, 3]
    residual: Norm of the forces on free vertices over that of the loads and reactions.
    iterations: Newton steps, over all load steps.
    factorizations: How many of them renewed the preconditioner.
    """

    vertices: np.ndarray
    residual: float
    iterations: int
    factorizations: int


class Problem(NamedTuple):
    """What stays while Newton's method runs: the energy, loads [V, 3], dofs in order [3F]."""

    energy: Energy
    loads: np.ndarray
    dofs: np.ndarray

    def potential(self, x):
        return self.energy.value(x) - float((self.loads * x).sum())

    def forces(self, x):
        """On every vertex, [3V], and their share on the free ones, [3F]."""
        forces = (self.loads - self.energy.gradient(x)).ravel()
        return forces, forces[self.dofs]

    def hessian(self, x):
        return self.energy.hessian(x)[self.dofs][:, self.dofs]


def equilibrium(
    energy: Energy, start, held, gravity=(0.0, 0.0, 0.0), tolerance=1e-10, steps=100, load_steps=1
) -> Equilibrium:
    """Rest under gravity, some vertices held where `start` has them.

    Args:
        start: [V, 3] m; handles at their targets.
        held: [V] bool
        tolerance: Of the residual; or what float64 rounds, if that is more.
        steps: Newton steps at most, in each load step.
        load_steps: Gravity grows in as many equal steps.

    Raises:
        RuntimeError: It doesn't converge.
    """
    x = np.array(start, np.float64)
    free = np.flatnonzero(~np.asarray(held))
    order = free[dissection_order(x[free], energy.edges, free)]
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    solver = NewtonStep()
    total = 0
    for load in np.arange(1, load_steps + 1) / load_steps:
        problem = Problem(energy, load * energy.masses[:, None] * np.array(gravity), dofs)
        for _ in range(steps):
            forces, free_forces = problem.forces(x)
            scale = max(np.linalg.norm(forces), np.linalg.norm(problem.loads))
            residual = np.linalg.norm(free_forces)
            if residual <= max(tolerance * scale, rounding(energy, x)):
                break
            total += 1
            step = np.zeros(x.size)
            step[dofs] = solver.solve(problem.hessian(x), free_forces)
            x = line_search(problem, x, step.reshape(-1, 3), free_forces @ step[dofs])
        else:
            raise RuntimeError(
                f"no equilibrium after {steps} Newton steps: a residual of {residual / scale:.1e}; "
                "give more load steps"
            )
    relative = float(residual / scale) if scale > 0 else 0.0
    return Equilibrium(x, relative, total, solver.factorizations)


def line_search(problem, x, step, slope):
    """x + t·step with the first t = 1, ½, ¼, … that lowers the potential enough."""
    before = problem.potential(x)
    slack = 1e-12 * abs(before)
    for t in 0.5 ** np.arange(40):
        if problem.potential(x + t * step) <= before - ARMIJO * t * slope + slack:
            break
    return x + t * step


def rounding(energy: Energy, x):
    """About how much force float64 positions can't resolve, as a norm over vertices [N]."""
    reach = np.abs(x).max() * np.finfo(float).eps
    return float(np.linalg.norm(energy.stiffnesses) * reach)


class NewtonStep:
    """Solves with a sequence of Hessians, keeping a factorization while it is good.

    Attributes:
        factorizations: How many were made.
    """

    def __init__(self):
        self.factorizations = 0
        self._factors = None

    def solve(self, hessian, forces):
        """A direction of descent: (hessian + s I)⁻¹ forces with the least s ≥ 0 tried."""
        if self._factors is not None:
            step = conjugate_gradients(hessian, forces, self._factors.solve)
            if step is not None:
                return step
        shift = 0.0
        while True:
            shifted = hessian + shift * sparse.eye_array(hessian.shape[0], format="csr")
            self._factors = factorize(shifted)
            self.factorizations += 1
            if self._factors is not None:
                step = conjugate_gradients(shifted, forces, self._factors.solve)
                if step is not None:
                    return step
            shift = max(10.0 * shift, 1e-4 * abs(hessian).max())


def factorize(hessian):
    """LU without pivoting, which is LDLᵀ; None unless every pivot is positive."""
    try:
        factors = splu(
            hessian.tocsc(),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # a pivot of exactly 0
        return None
    return factors if factors.U.diagonal().min() > 0 else None


def conjugate_gradients(matrix, right, precondition):
    """matrix⁻¹ right; None after negative curvature or too many iterations."""
    solution, residual = np.zeros_like(right), right.copy()
    z = precondition(residual)
    direction, product = z, residual @ z
    goal = CG_TOLERANCE * np.linalg.norm(right)
    for _ in range(CG_ITERATIONS):
        image = matrix @ direction
        curvature = direction @ image
        if not curvature > 0:
            return None
        step = product / curvature
        solution += step * direction
        residual -= step * image
        if np.linalg.norm(residual) <= goal:
            return solution
        z = precondition(residual)
        product, before = residual @ z, product
        direction = z + (product / before) * direction
    return None


def dissection_order(places, edges, ids):
    """Nested dissection: halves first, then the vertices of one that touch the other.  [F]

    Args:
        places: Of the vertices in question.  [F, 3]
        edges: Of the whole mesh.  [E, 2]
        ids: Of those vertices in the whole mesh, sorted.  [F]
    """
    known = np.isin(edges, ids).all(axis=1)
    first, second = np.searchsorted(ids, edges[known]).T
    count = len(ids)
    graph = sparse.csr_array((np.ones(len(first)), (first, second)), shape=(count, count))
    graph = (graph + graph.T).tocsr()
    order = []

    def split(part):
        along = places[part, np.ptp(places[part], axis=0).argmax()] if len(part) > LEAF else None
        if along is None or not (high := along > np.median(along)).any():
            order.append(part)
            return
        low_mark = np.zeros(count)
        low_mark[part[~high]] = 1.0
        touching = graph[part[high]] @ low_mark > 0
        split(part[~high])
        split(part[high][~touching])
        order.append(part[high][touching])

    split(np.arange(count))
    return np.concatenate(order)
