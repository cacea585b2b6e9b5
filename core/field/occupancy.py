"""Occupancy below the coarse tet: one bit per level-2 descendant, a sub-tet.

The path of a sub-tet is p = 8·k1 + k2.  Bit p of the tet's mask is 1 if the sub-tet may have
density; otherwise σ = 0 there.  The mask belongs to the rest shape, so it is valid in every pose.

Shapes: T tets, N samples.
"""

import numpy as np
import warp as wp

from ..geometry import TetMesh, child_of, into_child, path_corners

LEVELS = 2
SUBTET_COUNT = 64  # 8^LEVELS


def subtet_corners() -> np.ndarray:
    """Corners of the sub-tets in barycentric coordinates of the tet.  [64, corner, 4]"""
    return path_corners(LEVELS) / 2**LEVELS


def subtet_middles(mesh: TetMesh, vertices=None) -> np.ndarray:
    """The middles of all sub-tets, by default at rest.  [T, 64, 3] float32

    Args:
        vertices: Where those of the mesh are.  [V, 3]
    """
    vertices = mesh.rest_vertices if vertices is None else vertices
    corners = vertices[mesh.tets].astype(np.float32)
    return np.einsum("sk,tkx->tsx", subtet_corners().mean(axis=1).astype(np.float32), corners)


def pack_mask(occupied: np.ndarray) -> np.ndarray:
    """[T, 64] bool -> [T] uint64, bit p for sub-tet p."""
    bits = np.uint64(1) << np.arange(SUBTET_COUNT, dtype=np.uint64)
    return (occupied * bits).sum(axis=1, dtype=np.uint64)


def unpack_mask(mask: np.ndarray) -> np.ndarray:
    """[T] uint64 -> [T, 64] bool"""
    return ((mask[:, None] >> np.arange(SUBTET_COUNT, dtype=np.uint64)) & np.uint64(1)) > 0


def occupied_share(mask: np.ndarray) -> float:
    """Share of the sub-tets that may hold density."""
    return float(np.bitwise_count(mask).mean() / SUBTET_COUNT)


@wp.func
def subtet_of(bary: wp.vec4):
    """Path of the sub-tet that holds a point."""
    k1 = child_of(bary)
    k2 = child_of(into_child(k1, bary))
    return 8 * k1 + k2


@wp.func
def exit_distance(alpha: wp.vec4, slope: wp.vec4):
    """The smallest x where a coordinate of alpha + x slope falls to 0; 1e30 if none does."""
    distance = float(1.0e30)
    distance = wp.where(slope[0] < 0.0, wp.min(distance, -alpha[0] / slope[0]), distance)
    distance = wp.where(slope[1] < 0.0, wp.min(distance, -alpha[1] / slope[1]), distance)
    distance = wp.where(slope[2] < 0.0, wp.min(distance, -alpha[2] / slope[2]), distance)
    return wp.where(slope[3] < 0.0, wp.min(distance, -alpha[3] / slope[3]), distance)


@wp.func
def subtet_ahead(bary: wp.vec4, slope: wp.vec4):
    """The sub-tet that holds a point of a line, and the distance to the line's exit from it."""
    k1 = child_of(bary)
    alpha = into_child(k1, bary)
    direction = into_child(k1, slope, 0.0)
    k2 = child_of(alpha)
    distance = exit_distance(into_child(k2, alpha), into_child(k2, direction, 0.0))
    return 8 * k1 + k2, distance


@wp.func
def is_occupied(mask: wp.uint64, subtet: int):
    return ((mask >> wp.uint64(subtet)) & wp.uint64(1)) != wp.uint64(0)
