"""Run a script with the children's corners in the published order instead of Bey's.

    python tests/benchmarks/published_order.py SCRIPT [ARGUMENTS]

The eight children are the same regions, but the supplement of DeformRF lists their corners
in another order, and the order decides how the next level cuts (core/geometry/subdivision.py).
This is for comparison: what such a process writes is no model, since nothing in the file says
which order it needs.
"""

import runpy
import sys

import numpy as np
import warp as wp

from deformrf.core.geometry import subdivision
from deformrf.core.geometry.subdivision import child_corners, into_child

# Corner j of child k is corner ORDER[k, j] in Bey's order.
ORDER = np.array(
    [
        (0, 1, 2, 3),
        (1, 2, 0, 3),
        (2, 0, 1, 3),
        (3, 0, 2, 1),
        (0, 1, 2, 3),
        (0, 1, 3, 2),
        (3, 0, 2, 1),
        (3, 0, 1, 2),
    ]
)


@wp.func
def published_into_child(k: int, alpha: wp.vec4):
    """`into_child` for ORDER."""
    a = into_child(k, alpha)
    if k == 1:
        return wp.vec4(a[1], a[2], a[0], a[3])
    if k == 2:
        return wp.vec4(a[2], a[0], a[1], a[3])
    if k == 3 or k == 6:
        return wp.vec4(a[3], a[0], a[2], a[1])
    if k == 5:
        return wp.vec4(a[0], a[1], a[3], a[2])
    if k == 7:
        return wp.vec4(a[3], a[0], a[1], a[2])
    return a


@wp.func
def published_child_corners(k: int, a: wp.vec3i, b: wp.vec3i, c: wp.vec3i, d: wp.vec3i):
    """`child_corners` for ORDER."""
    e, f, g, h = child_corners(k, a, b, c, d)
    if k == 1:
        return f, g, e, h
    if k == 2:
        return g, e, f, h
    if k == 3 or k == 6:
        return h, e, g, f
    if k == 5:
        return e, f, h, g
    if k == 7:
        return h, e, f, g
    return e, f, g, h


def install():
    """Exchange the rule; before anything that uses it is imported, since that is by name."""
    early = [name for name in sys.modules if name.startswith("deformrf.core.field")]
    assert not early, f"imported too early: {early}"
    children = np.arange(8)[:, None]
    subdivision.CHILD_VERTICES = subdivision.CHILD_VERTICES[children, ORDER]
    subdivision.CHILD_FROM_PARENT = subdivision.CHILD_FROM_PARENT[children, ORDER]
    subdivision.PARENT_FROM_CHILD = np.linalg.inv(subdivision.CHILD_FROM_PARENT)
    subdivision.into_child = published_into_child
    subdivision.child_corners = published_child_corners


if __name__ == "__main__":
    install()
    sys.argv = sys.argv[1:]
    runpy.run_path(sys.argv[0], run_name="__main__")
