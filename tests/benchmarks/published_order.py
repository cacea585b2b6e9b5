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

from deformrf.core.geometry import child_of, into_child, subdivision

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
    """Corners of child k, at the child's scale, from its parent's."""
    if k == 0:
        return a + a, a + b, a + c, a + d
    if k == 1:
        return b + b, b + c, a + b, b + d
    if k == 2:
        return c + c, a + c, b + c, c + d
    if k == 3:
        return d + d, a + d, c + d, b + d
    if k == 4:
        return a + b, a + c, a + d, b + d
    if k == 5:
        return a + b, a + c, b + d, b + c
    if k == 6:
        return c + d, a + c, b + d, a + d
    return c + d, a + c, b + c, b + d


def replace_corner_entries():
    """Where the encoding knows Bey's descendants, let it descend."""
    from deformrf.core.field import Tables, encoding
    from deformrf.core.field.encoding import mat43ui
    from deformrf.core.field.hashing import products_entry

    @wp.func
    def corner_entry(tables: Tables, level: int, tet: int, y: wp.vec3i, products: mat43ui):
        start = tables.entry_starts[level]
        if level < tables.dense_level_count:
            rank = y[0] * (y[0] + 1) * (y[0] + 2) / 6 + y[1] * (y[1] + 1) / 2 + y[2]
            node = (tet + 1) * tables.node_counts[level] - 1 - rank
            return start + tables.node_ids[tables.node_starts[level] + node]
        h = wp.uint32(1 << level) * products[0]
        h += wp.uint32(y[0]) * products[1]
        h += wp.uint32(y[1]) * products[2]
        h += wp.uint32(y[2]) * products[3]
        return start + products_entry(h, tables.entry_masks[level])

    @wp.func
    def corner_entries(tables: Tables, level: int, tet: int, x: wp.vec3, products: mat43ui):
        alpha = wp.vec4(1.0 - x[0], x[0] - x[1], x[1] - x[2], x[2])
        a = wp.vec3i(0, 0, 0)
        b = wp.vec3i(1, 0, 0)
        c = wp.vec3i(1, 1, 0)
        d = wp.vec3i(1, 1, 1)
        i = int(0)
        while i < level:
            k = child_of(alpha)
            alpha = published_into_child(k, alpha)
            a, b, c, d = published_child_corners(k, a, b, c, d)
            i += 1
        e = wp.vec4i(
            corner_entry(tables, level, tet, a, products),
            corner_entry(tables, level, tet, b, products),
            corner_entry(tables, level, tet, c, products),
            corner_entry(tables, level, tet, d, products),
        )
        return e, alpha

    encoding.corner_entries = corner_entries


def install():
    """Exchange the rule; before anything that uses it is imported, since that is by name."""
    early = [name for name in sys.modules if name.startswith("deformrf.core.field")]
    assert not early, f"imported too early: {early}"
    children = np.arange(8)[:, None]
    subdivision.CHILD_VERTICES = subdivision.CHILD_VERTICES[children, ORDER]
    subdivision.CHILD_FROM_PARENT = subdivision.CHILD_FROM_PARENT[children, ORDER]
    subdivision.PARENT_FROM_CHILD = np.linalg.inv(subdivision.CHILD_FROM_PARENT)
    subdivision.into_child = published_into_child
    replace_corner_entries()


if __name__ == "__main__":
    install()
    sys.argv = sys.argv[1:]
    runpy.run_path(sys.argv[0], run_name="__main__")
