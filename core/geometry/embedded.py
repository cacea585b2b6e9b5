"""A surface whose vertices are fixed in the tets of a mesh, so that it deforms with them.

A point with barycentric coordinates w in the tet with corners c lies at Σ w_i · vertices[c_i], at
rest and in every pose.  The radiance field moves in the same way.

Shapes: N points, F triangles.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..definition.deformation import edges_of
from .mesh import TetMesh

MOST_STEPS = 64  # from tet to tet; a point that is farther away keeps the last one


@dataclass(frozen=True)
class EmbeddedPoints:
    """Points that tets carry."""

    corners: np.ndarray  # [N, 4] int32: vertices of the tet that carries each point
    weights: np.ndarray  # [N, 4] float32, sum 1; below 0 for points beside the mesh

    def points(self, vertices: ArrayLike) -> np.ndarray:
        """Where the points are while the mesh's vertices are there.  [N, 3]"""
        return np.einsum("nk,nkx->nx", self.weights, np.asarray(vertices)[self.corners])


@dataclass(frozen=True)
class EmbeddedSurface(EmbeddedPoints):
    """Triangles on points that tets carry."""

    faces: np.ndarray  # [F, 3] int32: points, counterclockwise from outside
    colors: np.ndarray  # [N, 3] uint8


def located(
    mesh: TetMesh, neighbours: np.ndarray, tets: ArrayLike, points: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """The tets that hold points at rest, found by walking from the given tets [N].

    A walk leaves a tet through the face that the point is farthest behind, and ends at the
    boundary at the latest.

    Returns:
        Tets [N], and barycentric coordinates in them [N, 4]; below 0 outside of the mesh.
    """
    tets, points = np.array(tets, np.int64), np.asarray(points, float)
    corners = mesh.rest_vertices[mesh.tets]
    inverses = np.linalg.inv(edges_of(mesh.rest_vertices, mesh.tets))  # [T, 3, 3]

    def coordinates(ids):
        inner = np.einsum("nij,nj->ni", inverses[tets[ids]], points[ids] - corners[tets[ids], 0])
        return np.column_stack([1.0 - inner.sum(axis=1), inner])

    weights = coordinates(np.arange(len(tets)))
    walking = np.arange(len(tets))
    for _ in range(MOST_STEPS):
        face = weights[walking].argmin(axis=1)
        following = neighbours[tets[walking], face]
        goes_on = (weights[walking, face] < 0.0) & (following >= 0)
        walking = walking[goes_on]
        if len(walking) == 0:
            break
        tets[walking] = following[goes_on]
        weights[walking] = coordinates(walking)
    return tets, weights
