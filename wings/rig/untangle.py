"""The pose nearest to a skinned one in which no tet is inverted.

Skinning folds what lies in a sharp bend, and weights alone can't prevent it: where two bones
fold onto each other, a coarse tet between them has no space.  With F_t(v) the deformation
gradient of tet t, V_t its rest volume, d_i the Laplacian's diagonal and x the skinned vertices,

    minimize  Σ_t V_t |F_t(v) − P(F_t(v))|² + a Σ_i d_i |v_i − x_i|²

P raises singular values to FLAT, the smallest one signed, so that P(F) = F wherever a tet is well:
only flat and inverted tets pull.  Stretched ones don't: where tets bridge two legs, they have to.
Local and global steps take turns (Bouaziz et al. 2014, projective dynamics): P with v held, then v
with P held, a linear system whose matrix is the Laplacian's.  a falls until no tet is flatter than
LEAST; where the smallest a leaves some, P raises theirs to LAST.
"""

import numpy as np

from ...core.geometry import TetMesh, signed_volumes
from .laplacian import laplacian, solved

FLAT = 0.1
LEAST = 0.01  # smallest volume ratio that is left
PULLS = (0.1, 0.03, 0.01, 0.003, 0.001, 0.001)  # a
LAST = 0.3  # with the last of them, in the place of FLAT, for tets that are flatter than LEAST
ROUNDS = 60  # for each a


class Untangler:
    """What poses of one mesh share: gradients and the Laplacian."""

    def __init__(self, mesh: TetMesh):
        x, tets = mesh.rest_vertices, mesh.tets
        self._tets, self._operator = tets, laplacian(mesh)
        self._volumes = signed_volumes(x, tets)
        corners = x[tets]
        inverse = np.linalg.inv(np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2))
        self._gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)

    def ratios(self, vertices: np.ndarray) -> np.ndarray:
        """Volumes over those at rest, negative in inverted tets.  [T]"""
        return signed_volumes(vertices, self._tets) / self._volumes

    def __call__(self, vertices: np.ndarray) -> np.ndarray:
        """The vertices, moved where tets are inverted or nearly so; else unchanged.  [V, 3]"""
        target = np.asarray(vertices, float)
        v = target
        raised = [FLAT] * (len(PULLS) - 1) + [LAST]
        for pull, high in zip(PULLS, raised, strict=True):
            for _ in range(ROUNDS):
                ratios = self.ratios(v)
                if ratios.min() > LEAST:
                    return v
                v = self._round(v, target, pull, np.where(ratios < LEAST, high, FLAT))
        return v

    def _round(self, v, target, pull, flat):
        well = np.einsum("tci,tcj->tij", v[self._tets], self._gradients)
        # σ₁ σ₂ ≤ |F|² / 2, so σ₃ ≥ 2 det F / |F|²: most tets are surely well.
        bound = 2.0 * np.linalg.det(well) / np.sum(well * well, axis=(1, 2))
        unsure = np.flatnonzero(~(bound >= flat))
        u, sizes, vt = np.linalg.svd(well[unsure])
        mirrored = np.linalg.det(u @ vt) < 0.0
        sizes[mirrored, 2] *= -1.0
        u[mirrored, :, 2] *= -1.0
        well[unsure] = u @ (np.maximum(sizes, flat[unsure, None])[:, :, None] * vt)
        pulls = self._volumes[:, None, None] * np.einsum("tij,tcj->tci", well, self._gradients)
        corners = self._tets.ravel()
        sources = [np.bincount(corners, p.ravel(), len(v)) for p in np.moveaxis(pulls, 2, 0)]
        weights = pull * self._operator.degrees
        return solved(
            self._operator, weights, np.stack(sources, axis=1) + weights[:, None] * target, start=v
        )
