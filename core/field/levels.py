"""How fine each level is, and which levels are finer than the images that trained them.

A pixel at distance t from a camera of focal length f (in pixels) is t / f wide.  A level
whose longest edge is shorter than the narrowest pixel that the object had in any training
image interpolates between vertices that no image can tell apart.

Lengths are in model units.  V vertices, N cameras.
"""

import numpy as np

from ..geometry import EDGES, TetMesh, path_corners

SHAPES_KNOWN = 2  # levels until Bey's subdivision has made all shapes that it makes


def level_edges(mesh: TetMesh, level_count: int):
    """Longest rest edge of each level's descendants.  [L]"""
    corners = mesh.rest_vertices[mesh.tets]  # [T, 4, 3]
    longest = []
    for level in range(min(level_count, SHAPES_KNOWN + 1)):
        weights = path_corners(level) / 2**level  # [8^l, corner, 4]
        spans = weights[:, EDGES[:, 0]] - weights[:, EDGES[:, 1]]
        spans = np.unique(spans.reshape(-1, 4), axis=0)  # children share most of them
        longest.append(np.sqrt((np.einsum("et,ntx->nex", spans, corners) ** 2).sum(-1).max()))
    while len(longest) < level_count:
        longest.append(0.5 * longest[-1])
    return np.array(longest)


def narrowest_pixel(positions, focals, vertices) -> float:
    """Width of a pixel where a camera comes closest to the object.

    Args:
        positions: Of the cameras, model space.  [N, 3]
        focals: In pixels, of the images that train; one, or one per camera (the larger
            one of a lens that has two).  [] or [N]
        vertices: Rest vertices of the object.  [V, 3]
    """
    distance = [np.linalg.norm(vertices - position, axis=1).min() for position in positions]
    return float((np.array(distance) / focals).min())


def levels_below_pixel(mesh: TetMesh, level_count: int, pixel: float):
    """The levels whose edges are all shorter than `pixel`, coarsest first.  List of int"""
    return np.flatnonzero(level_edges(mesh, level_count) < pixel).tolist()
