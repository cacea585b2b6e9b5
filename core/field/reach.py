"""Which table entries rendering can read: those that an occupied sub-tet reaches.

Only samples in occupied sub-tets have density (occupancy.py).  So rendering reads, at level l,
only corners of descendants that overlap an occupied sub-tet.  A hashed entry counts as reached
if any such corner is hashed to it.  A file may leave out all other entries, or store zeros for
them, and no image changes.  (A point on the face of a sub-tet may read a corner beyond it, but with
a weight as small as a rounding error.)

Let a cell have corner addresses A.  The corners of all its descendants m levels down are the
points Σ b_j A_j with integers b ≥ 0 of sum 2^m.  The kernel visits each of these *nodes* once
per cell; a loop over the descendants would visit a node up to 24 times.

Shapes: T tets, S cells (distinct level-l' descendants, l' = min(l, 2)).
"""

import numpy as np
import warp as wp

from ..base.device import start_warp
from ..geometry import TetMesh, path_corners, path_nodes
from .layout import Layout, hash_entry
from .occupancy import LEVELS, unpack_mask

NODES_PER_LAUNCH = 1 << 22  # between checks whether all entries of the level are reached

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


def occupied_cells(occupancy, level: int):
    """Whether each level-`level` descendant overlaps an occupied sub-tet.  [T, 8^level] bool"""
    occupied = unpack_mask(occupancy)
    if level >= LEVELS:
        return np.repeat(occupied, 8 ** (level - LEVELS), axis=1)
    return occupied.reshape(len(occupied), 8**level, -1).any(axis=2)


@wp.kernel
def mark_nodes_kernel(
    corners: wp.array(dtype=wp.vec3i),  # [4 S] addresses at the cells' level
    first: int,  # cell of thread 0
    size: int,  # 2^m
    mask: int,  # entry count - 1
    reached: wp.array(dtype=wp.uint8),  # [entries of the level] out; set, never cleared
):
    """Mark the hashed entries of all nodes of a cell, m levels further down."""
    cell = 4 * (first + wp.tid())
    a = corners[cell]
    b = corners[cell + 1]
    c = corners[cell + 2]
    d = corners[cell + 3]
    i = int(0)
    while i <= size:
        j = int(0)
        while i + j <= size:
            node = i * a + j * b + (size - i - j) * c
            step = d - c
            k = int(0)
            while i + j + k <= size:
                reached[hash_entry(node, mask)] = wp.uint8(1)  # every thread writes a 1
                node = node + step
                k += 1
            j += 1
        i += 1


def reached_entries(mesh: TetMesh, layout: Layout, occupancy, device="cpu"):
    """Which entries rendering can read, found on a Warp device.

    [T] uint64 -> [entries] bool, the levels one after another as in the table.
    """
    start_warp()
    reached = []
    for level, entry_count in enumerate(layout.entry_counts):
        if level < layout.dense_level_count:
            found = _reached_dense(layout.node_ids[level], occupied_cells(occupancy, level), level)
        else:
            found = _reached_hashed(mesh, occupancy, level, entry_count, device)
        reached.append(found)
    return np.concatenate(reached)


def _reached_dense(node_ids, cells, level):
    nodes, corner_nodes = path_nodes(level)
    incidence = np.zeros((len(corner_nodes), len(nodes)), np.float32)
    incidence[np.arange(len(corner_nodes))[:, None], corner_nodes] = 1.0
    reached = np.zeros(node_ids.max() + 1, bool)
    reached[node_ids[cells.astype(np.float32) @ incidence > 0.0]] = True
    return reached


def _reached_hashed(mesh, occupancy, level, entry_count, device):
    cell_level = min(level, LEVELS)
    tet, path = np.nonzero(occupied_cells(occupancy, cell_level))
    corners = path_corners(cell_level)[path] @ mesh.addresses[mesh.tets[tet]].astype(np.int64)
    corners = wp.array(corners.reshape(-1, 3).astype(np.int32), dtype=wp.vec3i, device=device)
    reached = wp.zeros(entry_count, dtype=wp.uint8, device=device)
    size = 2 ** (level - cell_level)
    chunk = max(1, NODES_PER_LAUNCH // ((size + 1) * (size + 2) * (size + 3) // 6))
    for first in range(0, len(tet), chunk):
        inputs = [corners, first, size, entry_count - 1]
        count = min(chunk, len(tet) - first)
        wp.launch(mark_nodes_kernel, count, inputs=inputs, outputs=[reached], device=device)
        if reached.numpy().all():
            break
    return reached.numpy() > 0
