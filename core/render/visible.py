"""A field without its empty tets: those that have no occupied sub-tet.

Tets without density give the object its solid interior in the dynamics, but rays would only lose
time in them.  Without them a ray enters the mesh where the density begins and leaves it where the
density ends.

The tets are sorted along a space-filling curve (Morton's), so neighboring tets are close in
memory.

Shapes: T tets, of which K stay.
"""

from dataclasses import replace

import numpy as np

from ..field import TetField
from ..geometry import morton_order


def visible_field(field: TetField) -> tuple[TetField, np.ndarray]:
    """The field without its empty tets, and the old id of each of its tets [K] int32.

    One tet stays if all are empty.  All vertices stay, so that poses of the field fit it.
    """
    mesh = field.mesh
    seen = field.occupancy != 0
    if not seen.any():
        seen[:1] = True
    ids = np.flatnonzero(seen)
    middles = mesh.rest_vertices[mesh.tets[ids]].mean(axis=1)
    low, high = middles.min(axis=0), middles.max(axis=0)
    ids = ids[morton_order(((middles - low) / np.maximum(high - low, 1e-30) * 1023).astype(int))]
    new_ids = np.full(mesh.tet_count + 1, -1, np.int32)  # the last one is for -1, outside
    new_ids[ids] = np.arange(len(ids), dtype=np.int32)
    layout = replace(field.layout, node_ids=tuple(nodes[ids] for nodes in field.layout.node_ids))
    visible = replace(
        field,
        mesh=replace(mesh, tets=mesh.tets[ids]),
        neighbours=new_ids[field.neighbours[ids]],
        occupancy=field.occupancy[ids],
        layout=layout,
    )
    return visible, ids.astype(np.int32)
