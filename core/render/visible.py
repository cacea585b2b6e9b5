"""The part of a field that can be seen: tets with an occupied sub-tet, along a curve.

Tets that hold no density keep an object solid for its dynamics; a ray has nothing to do in
them.  Without them it enters the mesh where something is and leaves it where nothing follows.

The tets are in the order of a space-filling curve (Morton's), so that what a warp or a core
reads of neighbouring tets lies side by side.

Shapes: T tets, of which K stay.
"""

from dataclasses import replace

import numpy as np

from ..field import TetField

CURVE_BITS = 10  # per axis


def visible_part(field: TetField):
    """The field without its empty tets; vertices stay, so that poses fit.

    One tet stays if all are empty.

    Returns:
        The part, and the old id of each of its tets [K] int32.
    """
    mesh = field.mesh
    seen = field.occupancy != 0
    if not seen.any():
        seen[:1] = True
    ids = np.flatnonzero(seen)
    ids = ids[np.argsort(morton_codes(mesh.rest_vertices[mesh.tets[ids]].mean(axis=1)))]
    new_ids = np.full(mesh.tet_count + 1, -1, np.int32)  # the last one is for -1, outside
    new_ids[ids] = np.arange(len(ids), dtype=np.int32)
    layout = replace(field.layout, node_ids=tuple(nodes[ids] for nodes in field.layout.node_ids))
    part = replace(
        field,
        mesh=replace(mesh, tets=mesh.tets[ids]),
        neighbours=new_ids[field.neighbours[ids]],
        occupancy=field.occupancy[ids],
        layout=layout,
    )
    return part, ids.astype(np.int32)


def morton_codes(points):
    """The place of each point [N, 3] on Morton's curve through their box.  [N] int64"""
    low, high = points.min(axis=0), points.max(axis=0)
    size = 2**CURVE_BITS - 1
    cells = ((points - low) / np.maximum(high - low, 1e-30) * size).astype(np.int64)
    bits = np.arange(CURVE_BITS)
    spread = ((cells[..., None] >> bits) & 1) << (3 * bits)  # [N, 3, bits]
    return (spread.sum(axis=-1) << np.arange(3)).sum(axis=-1)
