"""Linear elasticity with quadratic tets, in float64: what the solver's beams are compared with.

A tet has ten nodes, its corners and the middles of its edges, and in barycentric coordinates
the shape functions λ_i (2 λ_i − 1) and 4 λ_i λ_j.  With Lamé's constants λ and μ

    K_ab = ∫ λ ∂_i N_a ∂_j N_b + μ ∂_j N_a ∂_i N_b + μ δ_ij ∇N_a · ∇N_b,   M_ab = ρ ∫ N_a N_b

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

from deformrf.core.geometry import EDGES, signed_volumes

CHUNK = 4096  # tets whose matrices are made at once
# Quadrature that is exact for quadratic functions: four points of equal weight.
NEAR, FAR = (5.0 + 3.0 * math.sqrt(5.0)) / 20.0, (5.0 - math.sqrt(5.0)) / 20.0
POINTS = np.full((4, 4), FAR) + (NEAR - FAR) * np.eye(4)


def reference_mass():
    """∫ N_a N_b over a tet of volume 1, in 420ths of whole numbers.  [10, 10]"""
    mass = np.empty((10, 10))
    mass[:4, :4] = 1.0 + 5.0 * np.eye(4)
    at = (EDGES[:, :, None] == np.arange(4)).any(axis=1)  # corner at edge [6, 4]
    mass[4:, :4] = np.where(at, -4.0, -6.0)
    mass[:4, 4:] = mass[4:, :4].T
    mass[4:, 4:] = 8.0 * (1.0 + (at[:, None] & at[None]).sum(axis=2))
    mass[4:, 4:][np.eye(6, dtype=bool)] = 32.0
    return mass / 420.0


@dataclass(frozen=True)
class QuadraticTets:
    """A mesh of quadratic tets; nodes 0 to V − 1 are the vertices."""

    nodes: np.ndarray  # [N, 3] m
    tets: np.ndarray  # [T, 10] corners, then the middles of EDGES
    held: np.ndarray  # [N] bool

    @property
    def volumes(self):
        return signed_volumes(self.nodes, self.tets)

    def stiffness(self, lame, mu):
        """K of displacements in the order of nodes, x y z of each.  [3N, 3N] CSR, N/m"""
        size = 3 * len(self.nodes)
        total = sparse.csr_array((size, size))
        for first in range(0, len(self.tets), CHUNK):
            tets = self.tets[first : first + CHUNK]
            products = self._gradient_products(tets)
            blocks = lame * products + mu * products.swapaxes(3, 4)
            blocks += mu * np.trace(products, axis1=3, axis2=4)[..., None, None] * np.eye(3)
            dofs = (3 * tets[:, :, None] + np.arange(3)).astype(np.int32)
            rows = np.broadcast_to(dofs[:, :, None, :, None], blocks.shape).ravel()
            columns = np.broadcast_to(dofs[:, None, :, None, :], blocks.shape).ravel()
            entries = blocks.ravel(), (rows, columns)
            total = total + sparse.coo_array(entries, shape=(size, size)).tocsr()
        return total

    def _gradient_products(self, tets):
        """∫ ∂_i N_a ∂_j N_b.  [T, 10, 10, 3, 3]"""
        corners = self.nodes[tets[:, :4]]
        spans = (corners[:, 1:] - corners[:, :1]).swapaxes(1, 2)
        inner = np.linalg.inv(spans)  # rows are the gradients of λ_1 to λ_3
        slopes = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)  # [T, 4, 3]
        volumes = signed_volumes(self.nodes, tets)
        products = 0.0
        for point in POINTS:
            derivatives = np.zeros((10, 4))  # ∂N_a/∂λ_i at this point
            derivatives[np.arange(4), np.arange(4)] = 4.0 * point - 1.0
            for row, (i, j) in zip(derivatives[4:], EDGES, strict=True):
                row[i], row[j] = 4.0 * point[j], 4.0 * point[i]
            gradients = derivatives @ slopes  # [T, 10, 3]
            products = products + np.einsum("tai,tbj->tabij", gradients, gradients)
        return 0.25 * volumes[:, None, None, None, None] * products

    def mass(self, density):
        """ρ ∫ N_a N_b, the same for x, y and z.  [N, N] CSR, kg"""
        blocks = density * self.volumes[:, None, None] * reference_mass()
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
