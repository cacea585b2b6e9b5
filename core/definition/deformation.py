"""How deformation changes a tet: the linear map F of its inside, and quantities that follow from F.

    E0, E   [T, 3, 3]   edges from corner 0 to corners 1, 2, 3 as columns, at rest and now
    F       [T, 3, 3]   deformation gradient: current = F rest + a constant,   F = E E0⁻¹
    Q       [T, 3, 3]   orthogonal polar factor of F: the rotation nearest to F, or reflection
    σ_i     [T, 3]      singular values of F, the stretches, largest first
    s       [T]         fade: 1, but towards 0 where a tet becomes flat
    α(x)                barycentric coordinates of a current position x

    F = U diag(σ) Vᵀ,   Q = U Vᵀ
    s = smoothstep(10⁻³, 10⁻², σ_min / σ_max): 0 up to 10⁻³, 1 from 10⁻², y² (3 − 2y) between
    (α_1, α_2, α_3)(x) = E⁻¹ (x − corner 0),   α_0 = 1 − α_1 − α_2 − α_3

Q keeps a reflection: forced to be a rotation, it would jump where a tet turns inside out.  A tet
that has faded out has no coordinates, and no part in the image.
"""

from typing import NamedTuple

import numpy as np

FADED, UNFADED = 1e-3, 1e-2  # σ_min / σ_max


class Deformation(NamedTuple):
    """Of all tets.  Where s = 0, `gradients` and `inverse_f` are 0."""

    gradients: np.ndarray  # [T, 4, 4]: α(x) = gradients (x, 1)
    inverse_f: np.ndarray  # [T, 3, 3] F⁻¹
    rotations: np.ndarray  # [T, 3, 3] Q
    fades: np.ndarray  # [T] s


def deformation(rest_vertices, vertices, tets) -> Deformation:
    """F⁻¹, Q and s of the tets, and their barycentric coordinates, with the current vertices."""
    rest_edges, edges = edges_of(rest_vertices, tets), edges_of(vertices, tets)
    u, stretches, vt = np.linalg.svd(edges @ np.linalg.inv(rest_edges))
    ratios = stretches[:, 2] / np.maximum(stretches[:, 0], 1e-30)
    y = np.clip((ratios - FADED) / (UNFADED - FADED), 0.0, 1.0)
    fades = y * y * (3.0 - 2.0 * y)
    flat = fades <= 0.0
    inverse_edges = np.linalg.inv(np.where(flat[:, None, None], np.eye(3), edges))
    inverse_edges[flat] = 0.0
    gradients = np.zeros((len(tets), 4, 4))
    gradients[:, 1:, :3] = inverse_edges
    gradients[:, 1:, 3] = -np.einsum("tij,tj->ti", inverse_edges, vertices[tets[:, 0]])
    gradients[:, 0] = -gradients[:, 1:].sum(axis=1)
    gradients[:, 0, 3] += np.where(flat, 0.0, 1.0)
    return Deformation(gradients, rest_edges @ inverse_edges, u @ vt, fades)


def edges_of(vertices, tets):
    """Edges from corner 0 to the others, as columns.  [T, 3, 3]"""
    return np.swapaxes(vertices[tets[:, 1:]] - vertices[tets[:, :1]], 1, 2)
