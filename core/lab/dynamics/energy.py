"""The elastic energy that the constraints stand for, its gradient and its exact Hessian.

    edge:   ½ k (|x_i − x_j| − L)²        k = 1/α [N/m]
    volume: ½ κ C²,  C = 6 (V − V0)       κ = 1/α [N/m⁵]

    ∂²/∂x_i∂x_j of an edge = −k (n nᵀ + (1 − L/l) (I − n nᵀ)),   n = (x_i − x_j)/l
    Hessian of a volume    = κ g gᵀ + κ C ∂²(6V)

All in float64.  This is what the solver would reach with endless substeps, so statics.py
and dynamics.py measure it against this.

Shapes: V vertices, E edges, T tets, B 3x3 blocks of the Hessian (V + 2E).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ...deform import edge_constraints, lumped_masses, volume_constraints, volume_gradients
from ...geometry import signed_volumes


@dataclass(frozen=True)
class Energy:
    """Springs and volumes between vertices that have masses.

    Attributes:
        masses: [V] kg
        edges: Ends of each spring.  [E, 2]
        lengths: At rest.  [E] m
        stiffnesses: k.  [E] N/m
        tets: [T, 4]; T may be 0.  Each one's edges must be among the edges.
        volumes: 6 V0.  [T] m³
        volume_stiffnesses: κ.  [T] N/m⁵
    """

    masses: np.ndarray
    edges: np.ndarray
    lengths: np.ndarray
    stiffnesses: np.ndarray
    tets: np.ndarray
    volumes: np.ndarray
    volume_stiffnesses: np.ndarray

    def value(self, x):
        """Elastic energy at positions x [V, 3], in J."""
        energy = 0.5 * (self.stiffnesses * self._stretches(x)[2] ** 2).sum()
        if len(self.tets):
            growth = 6.0 * signed_volumes(x, self.tets) - self.volumes
            energy += 0.5 * (self.volume_stiffnesses * growth**2).sum()
        return float(energy)

    def gradient(self, x):
        """∂ energy / ∂x, minus the force [N].  [V, 3]"""
        directions, _, stretches = self._stretches(x)
        pulls = (self.stiffnesses * stretches)[:, None] * directions
        result = self._edge_sums @ pulls
        if len(self.tets):
            growth = 6.0 * signed_volumes(x, self.tets) - self.volumes
            pushes = (self.volume_stiffnesses * growth)[:, None, None]
            result += self._tet_sums @ (pushes * volume_gradients(x, self.tets)).reshape(-1, 3)
        return result

    def hessian(self, x):
        """∂² energy / ∂x².  [3V, 3V] sparse, CSR"""
        directions, lengths, stretches = self._stretches(x)
        outer = directions[:, :, None] * directions[:, None, :]
        across = (stretches / lengths)[:, None, None] * (np.eye(3) - outer)
        blocks = self.stiffnesses[:, None, None] * (outer + across)
        pairs = np.concatenate([blocks, blocks, -blocks, -blocks])
        data = self._pair_sums @ pairs.reshape(-1, 9)
        if len(self.tets):
            data += self._tet_pair_sums @ self._tet_blocks(x).reshape(-1, 9)
        vertex_count = len(self.masses)
        return sparse.bsr_matrix(
            (data.reshape(-1, 3, 3), *self._pattern), shape=(3 * vertex_count, 3 * vertex_count)
        ).tocsr()

    def _stretches(self, x):
        """Unit vectors [E, 3], lengths [E] and lengths less those at rest [E]."""
        along = x[self.edges[:, 0]] - x[self.edges[:, 1]]
        lengths = np.linalg.norm(along, axis=1)
        return along / lengths[:, None], lengths, lengths - self.lengths

    def _tet_blocks(self, x):
        """Hessian of each volume's energy.  [T, 4, 4, 3, 3]"""
        gradients = volume_gradients(x, self.tets)
        growth = 6.0 * signed_volumes(x, self.tets) - self.volumes
        origin, *others = (x[self.tets[:, i]] for i in range(4))
        e1, e2, e3 = (_cross_matrices(corner - origin) for corner in others)
        second = np.zeros((len(self.tets), 4, 4, 3, 3))  # of 6 V = e1 · (e2 × e3)
        for (a, b), matrix in {(1, 2): -e3, (2, 3): -e1, (1, 3): e2}.items():
            second[:, a, b], second[:, b, a] = matrix, -matrix
        second[:, 0, 1:] = -second[:, 1:, 1:].sum(axis=1)
        second[:, :, 0] = -second[:, :, 1:].sum(axis=2)
        outer = gradients[:, :, None, :, None] * gradients[:, None, :, None, :]
        scale = self.volume_stiffnesses[:, None, None, None, None]
        return scale * (outer + growth[:, None, None, None, None] * second)

    @cached_property
    def _edge_sums(self):
        """+1 at an edge's first end and −1 at its second.  [V, E] sparse"""
        count = len(self.edges)
        return sparse.csr_matrix(
            (np.tile([1.0, -1.0], count), (self.edges.ravel(), np.repeat(np.arange(count), 2))),
            shape=(len(self.masses), count),
        )

    @cached_property
    def _tet_sums(self):
        """1 at each corner of each tet.  [V, 4T] sparse"""
        count = self.tets.size
        return sparse.csr_matrix(
            (np.ones(count), (self.tets.ravel(), np.arange(count))),
            shape=(len(self.masses), count),
        )

    @cached_property
    def _block_keys(self):
        """Row · V + column of each block that isn't zero, sorted.  [B]"""
        first, second = self.edges.astype(np.int64).T
        count = len(self.masses)
        keys = [np.arange(count) * (count + 1), first * count + second, second * count + first]
        return np.unique(np.concatenate(keys))

    @cached_property
    def _pattern(self):
        """BSR's column of each block [B] and first block of each row [V + 1]."""
        rows, columns = np.divmod(self._block_keys, len(self.masses))
        return columns, np.searchsorted(rows, np.arange(len(self.masses) + 1))

    @cached_property
    def _pair_sums(self):
        """Which block each edge's ii, jj, ij and ji go to.  [B, 4E] sparse"""
        first, second = self.edges.astype(np.int64).T
        rows = np.concatenate([first, second, first, second])
        columns = np.concatenate([first, second, second, first])
        return self._block_sums(rows, columns)

    @cached_property
    def _tet_pair_sums(self):
        """The same for each tet's 16 pairs of corners.  [B, 16T] sparse"""
        tets = self.tets.astype(np.int64)
        return self._block_sums(np.repeat(tets, 4, axis=1).ravel(), np.tile(tets, 4).ravel())

    def _block_sums(self, rows, columns):
        blocks = np.searchsorted(self._block_keys, rows * len(self.masses) + columns)
        count = len(rows)
        return sparse.csr_matrix(
            (np.ones(count), (blocks, np.arange(count))), shape=(len(self._block_keys), count)
        )


def material_energy(rest_vertices, tets, material) -> Energy:
    """What the solver's constraints of a material amount to."""
    edges = edge_constraints(rest_vertices, tets)
    volumes = volume_constraints(rest_vertices, tets)
    bulk = material.bulk_modulus
    stiffnesses = 1.0 / volumes.compliances(bulk) if bulk > 0 else np.empty(0)
    count = len(stiffnesses)
    return Energy(
        masses=lumped_masses(rest_vertices, tets, material.density),
        edges=edges.vertices,
        lengths=edges.rest_lengths,
        stiffnesses=1.0 / edges.compliances(material.shear_modulus),
        tets=volumes.vertices[:count],
        volumes=volumes.rest_volumes[:count],
        volume_stiffnesses=stiffnesses,
    )


def uniform_energy(rest_vertices, tets, density, compliance) -> Energy:
    """Springs of one compliance α > 0 [m/N] at every edge, and no volumes."""
    edges = edge_constraints(rest_vertices, tets)
    return Energy(
        masses=lumped_masses(rest_vertices, tets, density),
        edges=edges.vertices,
        lengths=edges.rest_lengths,
        stiffnesses=np.full(len(edges.vertices), 1.0 / compliance),
        tets=np.empty((0, 4), np.int64),
        volumes=np.empty(0),
        volume_stiffnesses=np.empty(0),
    )


def _cross_matrices(vectors):
    """[v]× for each v, so that [v]× u = v × u.  [N, 3, 3]"""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.moveaxis(np.array(rows), 2, 0)
