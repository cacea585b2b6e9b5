"""Strain and change of volume of deformed tets, in float64, for pictures and figures.

    F     deformation gradient: a tet's edges are F times its edges at rest.  [3, 3]
    E     Green's strain, ½ (Fᵀ F − 1); its eigenvalues are e₁ ≥ e₂ ≥ e₃
    σᵢ    principal stretches √(1 + 2 eᵢ); the smallest one is negative in an inverted tet
    strain         max |σᵢ − 1|: 0 in any rigid motion, 0.1 if a direction is 10 % longer or shorter
    volume ratio   det F: 1 at rest, negative in an inverted tet

Shapes: V vertices, T tets.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..definition.deformation import edges_of
from ..geometry import signed_volumes


@dataclass(frozen=True)
class RestTets:
    """What strain needs of the tets of a rest shape."""

    tets: np.ndarray  # [T, 4] vertex ids
    inverses: np.ndarray  # [T, 3, 3] of the matrices whose columns are a tet's edges at rest
    volumes: np.ndarray  # [T]


def rest_tets(rest_vertices: ArrayLike, tets: np.ndarray) -> RestTets:
    """The tets of a shape [V, 3] whose volumes are positive."""
    rest = np.asarray(rest_vertices, float)
    return RestTets(tets, np.linalg.inv(edges_of(rest, tets)), signed_volumes(rest, tets))


def deformation_gradients(vertices: ArrayLike, rest: RestTets) -> np.ndarray:
    """F of each tet when the vertices are there [V, 3].  [T, 3, 3]"""
    return edges_of(np.asarray(vertices, float), rest.tets) @ rest.inverses


def volume_ratios(gradients: np.ndarray) -> np.ndarray:
    """det F.  [T, 3, 3] -> [T]"""
    return np.linalg.det(gradients)


def strains(gradients: np.ndarray) -> np.ndarray:
    """max |σᵢ − 1|.  [T, 3, 3] -> [T]"""
    green = 0.5 * (gradients.transpose(0, 2, 1) @ gradients - np.eye(3))
    highest, lowest = _extreme_eigenvalues(green)
    longest, shortest = (np.sqrt(np.maximum(1.0 + 2.0 * e, 0.0)) for e in (highest, lowest))
    shortest = np.where(np.linalg.det(gradients) < 0.0, -shortest, shortest)
    return np.maximum(abs(longest - 1.0), abs(shortest - 1.0))


def _extreme_eigenvalues(matrices):
    """The largest and the smallest eigenvalue of symmetric matrices [T, 3, 3].  [T], [T]

    By Smith's trigonometric formula (Communications of the ACM 4, 1961, 168), some ten times as
    fast as eigvalsh for many small matrices.
    """
    mean = np.trace(matrices, axis1=1, axis2=2) / 3.0
    deviator = matrices - mean[:, None, None] * np.eye(3)
    spread = np.sqrt((deviator**2).sum(axis=(1, 2)) / 6.0)
    third = 0.5 * np.linalg.det(deviator) / np.maximum(spread, 1e-100) ** 3
    angle = np.arccos(np.clip(third, -1.0, 1.0)) / 3.0
    highest = mean + 2.0 * spread * np.cos(angle)
    lowest = mean + 2.0 * spread * np.cos(angle + 2.0 * np.pi / 3.0)
    return highest, lowest


def at_vertices(values: np.ndarray, rest: RestTets, vertex_count: int) -> np.ndarray:
    """The means of the tets' values [T] about each vertex, by volume; 0 without a tet.  [V]"""
    ids = rest.tets.ravel()
    weights = np.repeat(rest.volumes, 4)
    total = np.bincount(ids, weights, vertex_count)
    sums = np.bincount(ids, weights * np.repeat(values, 4), vertex_count)
    return sums / np.maximum(total, 1e-100)
