"""The elastic energy that the solver's constraints stand for, with gradient and exact Hessian.

    edge:   ½ k (|x_i − x_j| − L)²        k = 1/α [N/m]
    volume: ½ κ C²,  C = 6 (V − V0)       κ = 1/α [N/m⁵]

    ∂²/∂x_i∂x_j of an edge = −k (n nᵀ + (1 − L/l) (I − n nᵀ)),   n = (x_i − x_j)/l
    Hessian of a volume    = κ g gᵀ + κ C ∂²(6V)

All in float64.  The solver would reach this energy's motion with endless substeps, so
references.py computes from it what the solver is compared with.

Shapes: V vertices, E edges, T tets.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from ....core.definition.solver import volume_gradients
from ....core.deform import edge_constraints, lumped_masses, volume_constraints
from ....core.geometry import signed_volumes


@dataclass(frozen=True)
class Energy:
    """Springs and volumes between vertices that have masses."""

    masses: np.ndarray  # [V] kg
    edges: np.ndarray  # ends of each spring [E, 2]
    lengths: np.ndarray  # at rest [E] m
    stiffnesses: np.ndarray  # k [E] N/m
    tets: np.ndarray  # [T, 4]; T may be 0
    volumes: np.ndarray  # 6 V0 [T] m³
    volume_stiffnesses: np.ndarray  # κ [T] N/m⁵

    def value(self, x):
        """Elastic energy at positions x [V, 3], in J."""
        springs = (self.stiffnesses * self._stretches(x)[2] ** 2).sum()
        return 0.5 * float(springs + (self.volume_stiffnesses * self._growth(x) ** 2).sum())

    def gradient(self, x):
        """∂ energy / ∂x, minus the force [N].  [V, 3]"""
        directions, _, stretches = self._stretches(x)
        pulls = (self.stiffnesses * stretches)[:, None] * directions
        pushes = (self.volume_stiffnesses * self._growth(x))[:, None, None]
        of_tets = (pushes * volume_gradients(x, self.tets)).reshape(-1, 3)
        return self._sums @ np.concatenate([pulls, -pulls, of_tets])

    def hessian(self, x):
        """∂² energy / ∂x².  [3V, 3V] sparse, CSR"""
        directions, lengths, stretches = self._stretches(x)
        outer = directions[:, :, None] * directions[:, None, :]
        across = (stretches / lengths)[:, None, None] * (np.eye(3) - outer)
        springs = self.stiffnesses[:, None, None] * (outer + across)
        signs = np.array([[1.0, -1.0], [-1.0, 1.0]])[:, :, None, None]
        hessian = self._assembled(self.edges, signs * springs[:, None, None])
        return hessian + self._assembled(self.tets, self._tet_blocks(x))

    def _assembled(self, corners, blocks):
        """The sum of 3 x 3 blocks [N, K, K, 3, 3] between corners [N, K].  [3V, 3V] CSR"""
        dofs = 3 * corners[:, :, None] + np.arange(3)
        rows = np.broadcast_to(dofs[:, :, None, :, None], blocks.shape)
        columns = np.broadcast_to(dofs[:, None, :, None, :], blocks.shape)
        size = 3 * len(self.masses)
        entries = blocks.ravel(), (rows.ravel(), columns.ravel())
        return sparse.coo_array(entries, shape=(size, size)).tocsr()

    def _stretches(self, x):
        """Unit vectors [E, 3], lengths [E] and lengths less those at rest [E]."""
        along = x[self.edges[:, 0]] - x[self.edges[:, 1]]
        lengths = np.linalg.norm(along, axis=1)
        return along / lengths[:, None], lengths, lengths - self.lengths

    def _growth(self, x):
        """C of each volume.  [T]"""
        return 6.0 * signed_volumes(x, self.tets) - self.volumes

    def _tet_blocks(self, x):
        """Hessian of each volume's energy.  [T, 4, 4, 3, 3]"""
        gradients = volume_gradients(x, self.tets)
        along = x[self.tets[:, 1:]] - x[self.tets[:, :1]]
        e1, e2, e3 = np.cross(np.eye(3), along[:, :, None]).swapaxes(0, 1)  # e1 @ u = e1 × u
        second = np.zeros((len(self.tets), 4, 4, 3, 3))  # of 6 V = e1 · (e2 × e3)
        for (a, b), matrix in {(1, 2): -e3, (2, 3): -e1, (1, 3): e2}.items():
            second[:, a, b], second[:, b, a] = matrix, -matrix
        second[:, 0, 1:] = -second[:, 1:, 1:].sum(axis=1)
        second[:, :, 0] = -second[:, :, 1:].sum(axis=2)
        outer = gradients[:, :, None, :, None] * gradients[:, None, :, None, :]
        scale = self.volume_stiffnesses[:, None, None, None, None]
        return scale * (outer + self._growth(x)[:, None, None, None, None] * second)

    @cached_property
    def _sums(self):
        """1 at both ends of each edge and at each corner of each tet.  [V, 2E + 4T] sparse"""
        vertices = np.concatenate([self.edges.T.ravel(), self.tets.ravel()])
        count = len(vertices)
        places = vertices, np.arange(count)
        return sparse.csr_array((np.ones(count), places), shape=(len(self.masses), count))


def material_energy(rest_vertices, tets, material) -> Energy:
    """The energy of the solver's constraints for a material."""
    edges = edge_constraints(rest_vertices, tets)
    volumes = volume_constraints(rest_vertices, tets)
    has_volumes = material.bulk_modulus > 0
    count = len(volumes.vertices) if has_volumes else 0
    return Energy(
        masses=lumped_masses(rest_vertices, tets, material.density),
        edges=edges.vertices,
        lengths=edges.rest_values,
        stiffnesses=edges.sheet_ratios.at(material.held_poisson_ratio)
        / edges.compliances(material.shear_modulus),
        tets=volumes.vertices[:count],
        volumes=volumes.rest_values[:count],
        volume_stiffnesses=1.0 / volumes.compliances(material.bulk_modulus)
        if has_volumes
        else np.empty(0),
    )
