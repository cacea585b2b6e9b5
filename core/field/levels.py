"""The edge length of each level, and which levels are finer than a pixel.

A pixel at distance t from a camera of focal length f (in pixels) is t / f wide.  A level is finer
than a pixel if its longest rest edge is shorter than the width of a pixel at the object.  Such a
level interpolates between vertices that coincide in the image.  The viewer, the view mode `levels`
and the report use this one definition.

Lengths are in model units.  L levels.
"""

import numpy as np
from numpy.typing import ArrayLike

from ..geometry import EDGES, TetMesh


def level_edges(mesh: TetMesh, level_count: int) -> np.ndarray:
    """Longest rest edge of each level's descendants.  [L], never increasing

    A descendant l levels below the tet v0 v1 v2 v3 has, divided by 2^l, edges of the tet and
    the vector v0 + v2 - v1 - v3, which is twice the inner diagonal (../geometry/lattice.py).
    """
    corners = mesh.rest_vertices[mesh.tets]  # [T, 4, 3]
    spans = corners[:, EDGES[:, 0]] - corners[:, EDGES[:, 1]]
    diagonals = corners[:, 0] + corners[:, 2] - corners[:, 1] - corners[:, 3]
    coarse = np.linalg.norm(spans, axis=-1).max()
    nested = max(coarse, np.linalg.norm(diagonals, axis=-1).max())
    levels = np.arange(level_count)
    return np.where(levels == 0, coarse, nested) / 2.0**levels


def below_pixel(edges: ArrayLike, pixel: ArrayLike) -> np.ndarray:
    """Whether each level is finer than a pixel of that width where it meets the object.

    `level_edges` [L], [...] -> [..., L] bool
    """
    return np.asarray(edges) < np.asarray(pixel)[..., None]
