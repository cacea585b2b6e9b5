"""Linear elasticity with quadratic tets, in float64: what the solver's beams are compared with.

The matrices of each tet are those of core/deform/quadratic.py; test_locking.py compares a beam of
them with the theory.

A node is held if it is a held vertex or lies between two held nodes.

Units: SI.  Shapes: V vertices, N nodes, T tets.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse.csgraph import reverse_cuthill_mckee

from deformrf.core.deform.quadratic import consistent_masses, element_stiffnesses
from deformrf.core.geometry import EDGES

CHUNK = 4096  # tets whose matrices are made at once


@dataclass(frozen=True)
class QuadraticTets:
    """A mesh of quadratic tets; nodes 0 to V − 1 are the vertices."""

    nodes: np.ndarray  # [N, 3] m
    tets: np.ndarray  # [T, 10] corners, then the middles of EDGES
    held: np.ndarray  # [N] bool

    def stiffness(self, lame, mu):
        """K of displacements in the order of nodes, x y z of each.  [3N, 3N] CSR, N/m"""
        size = 3 * len(self.nodes)
        total = sparse.csr_array((size, size))
        for first in range(0, len(self.tets), CHUNK):
            tets = self.tets[first : first + CHUNK]
            blocks = element_stiffnesses(self.nodes, tets[:, :4], lame, mu)
            dofs = (3 * tets[:, :, None] + np.arange(3)).astype(np.int32).reshape(-1, 30)
            rows = np.broadcast_to(dofs[:, :, None], blocks.shape).ravel()
            columns = np.broadcast_to(dofs[:, None], blocks.shape).ravel()
            entries = blocks.ravel(), (rows, columns)
            total = total + sparse.coo_array(entries, shape=(size, size)).tocsr()
        return total

    def mass(self, density):
        """ρ ∫ N_a N_b, the same for x, y and z.  [N, N] CSR, kg"""
        blocks = density * consistent_masses(self.nodes, self.tets[:, :4])
        rows = np.broadcast_to(self.tets[:, :, None], blocks.shape).ravel()
        columns = np.broadcast_to(self.tets[:, None, :], blocks.shape).ravel()
        shape = (len(self.nodes),) * 2
        return sparse.coo_array((blocks.ravel(), (rows, columns)), shape=shape).tocsr()


def quadratic(vertices, tets, held) -> QuadraticTets:
    """Quadratic tets on a mesh; `held` is a mask of vertices [V]."""
    ends = np.sort(tets[:, EDGES].reshape(-1, 2), axis=1)
    parents, middle = np.unique(ends, axis=0, return_inverse=True)
    parents = np.concatenate([np.repeat(np.arange(len(vertices))[:, None], 2, axis=1), parents])
    middles = middle.reshape(-1, 6) + len(vertices)
    return QuadraticTets(
        nodes=vertices[parents].mean(axis=1),
        tets=np.concatenate([tets, middles], axis=1),
        held=held[parents].all(axis=1),
    )


class Solid:
    """An elastic body that is partly held: its sag and its lowest frequency."""

    def __init__(self, mesh: QuadraticTets, lame, mu, density):
        self.mesh = mesh
        self._dofs = (3 * np.flatnonzero(~mesh.held)[:, None] + np.arange(3)).ravel()
        self._stiffness = mesh.stiffness(lame, mu)[self._dofs][:, self._dofs]
        mass = sparse.kron(mesh.mass(density), sparse.eye_array(3), format="csr")
        self._mass = mass[self._dofs][:, self._dofs]
        self._loads = mass[self._dofs]  # of all nodes

    def sag(self, gravity):
        """Displacements under gravity [m/s²].  [N, 3]"""
        return self._whole(self._solve(self._loads @ np.tile(gravity, len(self.mesh.nodes))))

    def lowest_mode(self, start, rounds=4):
        """The lowest frequency of the modes that `start` [N, 3] has a part of: Hz, mode [N, 3].

        Each round makes the frequency's error smaller by (f₁/f₂)⁴, for a beam 1/1500.
        """
        u = start.ravel()[self._dofs]
        for _ in range(rounds):
            u = self._solve(self._mass @ u)
            u /= math.sqrt(u @ (self._mass @ u))
        return math.sqrt(u @ (self._stiffness @ u)) / (2.0 * math.pi), self._whole(u)

    def _whole(self, values):
        u = np.zeros(3 * len(self.mesh.nodes))
        u[self._dofs] = values
        return u.reshape(-1, 3)

    @cached_property
    def _factors(self):
        """Cholesky factors of the stiffness, a band in the order of Cuthill and McKee."""
        order = reverse_cuthill_mckee(self._stiffness.tocsr(), symmetric_mode=True)
        matrix = self._stiffness[order][:, order].tocoo()
        below = matrix.row >= matrix.col
        rows, columns = matrix.row[below], matrix.col[below]
        band = np.zeros(((rows - columns).max() + 1, matrix.shape[0]))
        band[rows - columns, columns] = matrix.data[below]
        return order, cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)

    def _solve(self, right):
        order, factors = self._factors
        solution = np.empty_like(right)
        solution[order] = cho_solve_banded((factors, True), right[order], check_finite=False)
        return solution
