"""A field with fewer tets: the same density and color in those that stay."""

from dataclasses import replace

import numpy as np

from ..geometry import extract, path_nodes, tet_neighbours
from .field import TetField
from .layout import FEATURES, hash_address, make_layout


def reduced(field: TetField, keep) -> TetField:
    """The field without some tets; `keep` says which stay.  [T] bool

    Dense levels lose the entries of what goes.  A hashed level stays as it is, or becomes dense
    if it fits now.

    Raises:
        ValueError: No tet stays.
    """
    if not keep.any():
        raise ValueError("no tet of the model would be left: keep at least one")
    mesh, used = extract(field.mesh, keep)
    options, old = field.options, field.layout
    layout = make_layout(mesh, options.level_count, options.table_size, options.dense_levels)
    parts = []
    for level, count in enumerate(layout.entry_counts):
        before = field.table[old.offsets[level] : old.offsets[level + 1]]
        if level < layout.dense_level_count:
            part = np.zeros((count, FEATURES), field.table.dtype)
            part[layout.node_ids[level]] = before[_entries(field, mesh, level, keep)]
            before = part
        parts.append(before)
    return replace(
        field,
        mesh=mesh,
        neighbours=tet_neighbours(mesh.tets),
        occupancy=field.occupancy[keep],
        layout=layout,
        table=np.concatenate(parts),
        stiffness=None if field.stiffness is None else field.stiffness[used],
    )


def _entries(field, mesh, level, keep):
    """The entries of the field's level at the nodes of the tets in `mesh`, those kept.  [T', n]"""
    if level < field.layout.dense_level_count:
        return field.layout.node_ids[level][keep]
    nodes, _ = path_nodes(level)
    corners = mesh.addresses[mesh.tets].astype(np.int64)
    addresses = np.einsum("nc,tcx->tnx", nodes, corners)
    return hash_address(addresses, field.layout.entry_counts[level])
