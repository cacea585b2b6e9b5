"""Recursive subdivision of one tetrahedron on devices; core/definition/subdivision.py defines it.

A point's descendant at level l can also be found without the levels between.  In lattice
coordinates

    x = (α1 + α2 + α3, α2 + α3, α3),        1 ≥ x1 ≥ x2 ≥ x3 ≥ 0

the tet is a simplex of Kuhn's triangulation of the cube.  In Bey's order its descendants are the
simplices of the cubes with edge 2^-l.  The point y = 2^l·x lies in the cube at c = floor(y).  The
corners of its descendant lead from c to c + (1, 1, 1), one step along each axis: first along that
of the largest fraction y - c, last along that of the smallest.

Shapes: N points.  Barycentric coordinates are [..., 4], sum to one, and are
dimensionless.
"""

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import warp as wp

from ..definition.subdivision import CHILD_VERTICES


@cache
def path_corners(levels: int):
    """Corners of every descendant after `levels` levels, by path.  [8^levels, corner, 4] int64

    They are barycentric coordinates in the coarse tet, times 2^levels.
    """
    corners = np.eye(4, dtype=np.int64)[None]  # [paths, corner, 4]
    for _ in range(levels):
        a, b = CHILD_VERTICES[..., 0], CHILD_VERTICES[..., 1]
        corners = (corners[:, a] + corners[:, b]).reshape(-1, 4, 4)
    return corners


@cache
def path_nodes(levels: int):
    """The distinct corners of all descendants of one tet, its nodes.

    Returns:
        nodes: Integer barycentric coordinates, sum 2^levels.  [n, 4]
        corner_nodes: The node at each descendant's corners.  [8^levels, 4] int32
    """
    size = 2**levels
    nodes = np.array([b for b in product(range(size + 1), repeat=4) if sum(b) == size])
    rank = {tuple(b): i for i, b in enumerate(nodes.tolist())}
    corners = path_corners(levels)
    ids = [rank[tuple(b)] for b in corners.reshape(-1, 4).tolist()]
    return nodes, np.array(ids, np.int32).reshape(-1, 4)


@wp.func
def child_of(alpha: wp.vec4):
    """The child, 0..7, that holds a point; on a shared face either neighbor."""
    k = int(4)
    if alpha[1] + alpha[2] >= 0.5:
        k += 1
    if alpha[2] + alpha[3] >= 0.5:
        k += 2
    if alpha[0] >= 0.5:
        k = 0
    if alpha[1] >= 0.5:
        k = 1
    if alpha[2] >= 0.5:
        k = 2
    if alpha[3] >= 0.5:
        k = 3
    return k


@wp.func
def into_child(k: int, alpha: wp.vec4, total: float = 1.0):
    """C[k] @ alpha, with rows simplified by sum(alpha) = total: 1 for a point, 0 for a direction.

    The function has no branches, because neighboring threads enter different children.
    """
    s = 2.0 * (alpha[1] + alpha[2])
    u = 2.0 * (alpha[2] + alpha[3])
    a = 2.0 * alpha
    inner0 = wp.where(k < 6, total - u, wp.where(k == 6, total - a[3], a[0]))
    inner1 = wp.where(k < 6, wp.where(k == 4, a[2], total - a[1]), total - s)
    inner1 = wp.where(k == 7, s - total, inner1)
    inner2 = wp.where(k < 6, wp.where(k == 4, total - s, s - total), a[1])
    inner2 = wp.where(k == 7, total - a[2], inner2)
    inner3 = wp.where(k < 6, wp.where(k == 4, total - a[0], a[3]), u - total)
    return wp.vec4(
        wp.where(k < 4, a[0] - wp.where(k == 0, total, 0.0), inner0),
        wp.where(k < 4, a[1] - wp.where(k == 1, total, 0.0), inner1),
        wp.where(k < 4, a[2] - wp.where(k == 2, total, 0.0), inner2),
        wp.where(k < 4, a[3] - wp.where(k == 3, total, 0.0), inner3),
    )


@wp.func
def lattice_point(alpha: wp.vec4):
    """The lattice coordinates x of a point, which may be outside by a rounding error."""
    z = wp.max(alpha[3], 0.0)
    y = z + wp.max(alpha[2], 0.0)
    return wp.vec3(wp.min(y + wp.max(alpha[1], 0.0), 1.0), wp.min(y, 1.0), wp.min(z, 1.0))


@wp.func
def lattice_cell(x: wp.vec3, level: int):
    """The cube c that holds a point, and the point's fractions in it."""
    size = 1 << level
    y = float(size) * x
    last = size - 1  # a point at the upper end is in the last cube
    c = wp.vec3i(wp.min(int(y[0]), last), wp.min(int(y[1]), last), wp.min(int(y[2]), last))
    return c, wp.vec3(y[0] - float(c[0]), y[1] - float(c[1]), y[2] - float(c[2]))


@wp.func
def lattice_axes(fraction: wp.vec3):
    """Axes, 0..2, of the first and the last step.

    Of equal fractions the first axis comes first, which keeps all corners in the coarse tet.
    """
    xy = fraction[0] >= fraction[1]
    xz = fraction[0] >= fraction[2]
    yz = fraction[1] >= fraction[2]
    first = wp.where(xy and xz, 0, wp.where(yz, 1, 2))
    last = wp.where(xz and yz, 2, wp.where(xy, 1, 0))
    return first, last


@wp.func
def lattice_weights(fraction: wp.vec3):
    """The point's barycentric coordinates in its descendant, in the order of the steps."""
    low = wp.min(fraction[0], fraction[1])
    high = wp.max(fraction[0], fraction[1])
    middle = wp.max(low, wp.min(high, fraction[2]))
    low = wp.min(low, fraction[2])
    high = wp.max(high, fraction[2])
    return wp.vec4(1.0 - high, high - middle, middle - low, low)


@wp.func
def along(axis: int, x: Any, y: Any, z: Any):
    """x, y or z: the value that belongs to an axis."""
    return wp.where(axis == 0, x, wp.where(axis == 1, y, z))
