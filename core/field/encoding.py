"""The recursive tetrahedral encoding on devices; core/definition/encoding.py defines it.

Shapes: N samples, L levels, F = 4 features per entry, T tets.  `table` contains the levels
one after another, [sum of entry counts, F]; layout.py gives their offsets.
"""

from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from ..base.wide import load_wide_half, vec4h
from ..geometry import TetMesh, along, lattice_axes, lattice_cell, lattice_point, lattice_weights
from .layout import Layout, hash_products, products_entry

mat43ui = wp.types.matrix((4, 3), wp.uint32)
ENCODING_H = Path(__file__).parent / "encoding.h"  # the same for vectors of a CPU
PREFETCH_SAMPLES = wp.constant(8)

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.struct
class Tables:
    """Arrays of a mesh and its layout that the kernels need, on a device."""

    products: wp.array(dtype=mat43ui)  # [T] hash_products of corner 0 and of the edges 01, 12, 23
    node_ids: wp.array(dtype=int)  # all dense levels, [T, n_l] each
    node_starts: wp.array(dtype=int)  # [D] where each dense level's ids begin
    node_counts: wp.array(dtype=int)  # [D] nodes per tet
    entry_starts: wp.array(dtype=int)  # [L]
    entry_masks: wp.array(dtype=int)  # [L] entry count - 1 where hashed
    dense_level_count: int


def make_tables(mesh: TetMesh, layout: Layout, device: wp.DeviceLike) -> Tables:
    """Copy a layout to a device."""
    corners = mesh.addresses[mesh.tets]  # [T, 4, 3]
    corners[:, 1:] -= corners[:, :-1].copy()
    node_ids = [ids.ravel() for ids in layout.node_ids]
    node_starts = np.cumsum([0, *map(len, node_ids)])[:-1].astype(np.int32)
    node_ids = np.concatenate([*node_ids, np.zeros(1, np.int32)])  # not empty without any
    node_counts = np.array([ids.shape[1] for ids in layout.node_ids], np.int32)
    tables = Tables()
    with wp.ScopedDevice(device):
        tables.products = wp.array(hash_products(corners), dtype=mat43ui)
        tables.node_ids = wp.array(node_ids, dtype=int)
        tables.node_starts = wp.array(node_starts, dtype=int)
        tables.node_counts = wp.array(node_counts, dtype=int)
        tables.entry_starts = wp.array(layout.offsets[:-1].astype(np.int32), dtype=int)
        tables.entry_masks = wp.array(np.array(layout.entry_counts, np.int32) - 1, dtype=int)
    tables.dense_level_count = layout.dense_level_count
    return tables


@wp.func
def dense_nodes(tables: Tables, level: int, tet: int, cell: wp.vec3i, first: int, last: int):
    """Indices into `node_ids` of a descendant's corners.

    path_nodes counts down in y1, then y2, then y3 of the corner:
    node = node_count - 1 - (C(y1 + 2, 3) + C(y2 + 1, 2) + y3).
    """
    nx = (cell[0] + 1) * (cell[0] + 2) / 2
    ny = cell[1] + 1
    node = (tet + 1) * tables.node_counts[level] - 1 + tables.node_starts[level]
    node -= nx * cell[0] / 3 + ny * cell[1] / 2 + cell[2]
    end = node - nx - ny - 1
    return wp.vec4i(node, node - along(first, nx, ny, 1), end + along(last, nx, ny, 1), end)


@wp.func
def hashed_entries(
    tables: Tables, level: int, products: mat43ui, cell: wp.vec3i, first: int, last: int
):
    """Entries of a descendant's corners in a hashed level."""
    start = tables.entry_starts[level]
    mask = tables.entry_masks[level]
    sx, sy, sz = products[1], products[2], products[3]
    h = (
        wp.uint32(1 << level) * products[0]
        + wp.uint32(cell[0]) * sx
        + wp.uint32(cell[1]) * sy
        + wp.uint32(cell[2]) * sz
    )
    end = h + sx + sy + sz
    return wp.vec4i(
        start + products_entry(h, mask),
        start + products_entry(h + along(first, sx, sy, sz), mask),
        start + products_entry(end - along(last, sx, sy, sz), mask),
        start + products_entry(end, mask),
    )


@wp.func
def corner_entries(tables: Tables, level: int, tet: int, x: wp.vec3, products: mat43ui):
    """Entries of the corners of the descendant that holds a lattice_point x, and their weights.

    `products` is tables.products[tet].
    """
    cell, fraction = lattice_cell(x, level)
    first, last = lattice_axes(fraction)
    e = wp.vec4i()
    if level < tables.dense_level_count:
        start = tables.entry_starts[level]
        nodes = dense_nodes(tables, level, tet, cell, first, last)
        e[0] = start + tables.node_ids[nodes[0]]
        e[1] = start + tables.node_ids[nodes[1]]
        e[2] = start + tables.node_ids[nodes[2]]
        e[3] = start + tables.node_ids[nodes[3]]
    else:
        e = hashed_entries(tables, level, products, cell, first, last)
    return e, lattice_weights(fraction)


@wp.func
def mixed(table: wp.array(dtype=vec4h), e: wp.vec4i, weights: wp.vec4):
    """The weighted sum of four entries."""
    a = weights[0] * load_wide_half(table, e[0])
    b = weights[1] * load_wide_half(table, e[1])
    c = weights[2] * load_wide_half(table, e[2])
    d = weights[3] * load_wide_half(table, e[3])
    return (a + b) + (c + d)


@wp.func
def encoded_half(
    tables: Tables,
    table: wp.array(dtype=vec4h),
    nodes: wp.array(dtype=vec4h),
    level: int,
    tet: int,
    x: wp.vec3,
    products: mat43ui,
):
    """A level's features of a point, from a table in half precision and its `node_table`."""
    cell, fraction = lattice_cell(x, level)
    first, last = lattice_axes(fraction)
    weights = lattice_weights(fraction)
    f = wp.vec4()
    if level < tables.dense_level_count:
        f = mixed(nodes, dense_nodes(tables, level, tet, cell, first, last), weights)
    else:
        f = mixed(table, hashed_entries(tables, level, products, cell, first, last), weights)
    return f


@wp.func
def widened(entry: Any):
    return wp.vec4(float(entry[0]), float(entry[1]), float(entry[2]), float(entry[3]))


@wp.func
def rounded(features: wp.array2d(dtype=Any), f: wp.vec4):
    """f in the type of `features`."""
    return features.dtype(
        features.dtype.dtype(f[0]),
        features.dtype.dtype(f[1]),
        features.dtype.dtype(f[2]),
        features.dtype.dtype(f[3]),
    )


@wp.func_native("""
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    // One atomic for the entry instead of one for each feature.
    atomicAdd(reinterpret_cast<float4*>(&wp::index(table_grad, entry)),
              make_float4(value[0], value[1], value[2], value[3]));
#else
    atomic_add(table_grad, entry, value);
#endif
""")
def add_to_entry(table_grad: wp.array(dtype=wp.vec4), entry: int, value: wp.vec4): ...


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    __builtin_prefetch(&wp::index(table, entry));
#endif
""")
def prefetch(table: wp.array(dtype=Any), entry: int): ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return false;
#else
    return true;
#endif
""")
def on_cpu() -> bool: ...


@wp.func
def prefetch_entries(
    tables: Tables, table: wp.array(dtype=Any), tet: int, bary: wp.vec4, level_count: int
):
    """Prefetch a later sample's entries of the hashed levels, which are rarely in the cache."""
    if tet < 0:
        return
    x = lattice_point(bary)
    products = tables.products[tet]
    level = int(tables.dense_level_count)
    while level < level_count:
        e, _ = corner_entries(tables, level, tet, x, products)
        prefetch(table, e[0])
        prefetch(table, e[1])
        prefetch(table, e[2])
        prefetch(table, e[3])
        level += 1


@wp.kernel
def encode_kernel(
    tables: Tables,
    table: wp.array(dtype=Any),  # [entries] vec4 or vec4h
    sample_tet: wp.array(dtype=int),  # [N] -1: no sample, zeros come out
    sample_bary: wp.array(dtype=wp.vec4),  # [N]
    level_count: int,
    features: wp.array2d(dtype=Any),  # [N, L] out, vec4 or vec4h
):
    """`encode` of core/definition; sums are float32 whatever the table is."""
    n = wp.tid()
    if on_cpu():
        ahead = wp.min(n + PREFETCH_SAMPLES, sample_tet.shape[0] - 1)
        prefetch_entries(tables, table, sample_tet[ahead], sample_bary[ahead], level_count)
    tet = sample_tet[n]
    level = int(0)
    if tet < 0:
        while level < level_count:
            features[n, level] = rounded(features, wp.vec4())
            level += 1
        return
    x = lattice_point(sample_bary[n])
    products = tables.products[tet]
    while level < level_count:
        e, weights = corner_entries(tables, level, tet, x, products)
        f = (
            weights[0] * widened(table[e[0]])
            + weights[1] * widened(table[e[1]])
            + weights[2] * widened(table[e[2]])
            + weights[3] * widened(table[e[3]])
        )
        features[n, level] = rounded(features, f)
        level += 1


@wp.kernel
def encode_backward_kernel(
    tables: Tables,
    sample_tet: wp.array(dtype=int),  # [N]
    sample_bary: wp.array(dtype=wp.vec4),  # [N]
    features_grad: wp.array2d(dtype=Any),  # [N, L] vec4 or vec4h
    table_grad: wp.array(dtype=wp.vec4),  # [entries] added to
):
    n = wp.tid()
    tet = sample_tet[n]
    if tet < 0:
        return
    x = lattice_point(sample_bary[n])
    products = tables.products[tet]
    level = int(0)
    while level < features_grad.shape[1]:
        e, weights = corner_entries(tables, level, tet, x, products)
        g = widened(features_grad[n, level])
        add_to_entry(table_grad, e[0], weights[0] * g)
        add_to_entry(table_grad, e[1], weights[1] * g)
        add_to_entry(table_grad, e[2], weights[2] * g)
        add_to_entry(table_grad, e[3], weights[3] * g)
        level += 1


# Without these lines the first launch with another type would compile the module anew.
for _entry in (wp.vec4, vec4h):
    wp.overload(
        encode_kernel, {"table": wp.array(dtype=_entry), "features": wp.array2d(dtype=_entry)}
    )
    wp.overload(encode_backward_kernel, {"features_grad": wp.array2d(dtype=_entry)})
