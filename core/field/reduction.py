"""Remove tets from a field, or its finest levels: the rest stays as it is."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..definition.encoding import hash_address
from ..geometry import extract, face_components, path_nodes, tet_neighbours
from .field import TetField
from .layout import FEATURES, Layout, make_layout
from .occupancy import pack_mask, subtet_middles, unpack_mask
from .packing import reduced_rig

SPECK = 0.01  # of the matter: a smaller part is a speck


def reduced(field: TetField, keep: np.ndarray) -> TetField:
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
    kept = []
    for level, count in enumerate(layout.entry_counts):
        before = field.table[old.offsets[level] : old.offsets[level + 1]]
        if level < layout.dense_level_count:
            entries = np.zeros((count, FEATURES), field.table.dtype)
            entries[layout.node_ids[level]] = before[_entries(field, mesh, level, keep)]
            before = entries
        kept.append(before)
    return replace(
        field,
        mesh=mesh,
        neighbours=tet_neighbours(mesh.tets),
        occupancy=field.occupancy[keep],
        layout=layout,
        table=np.concatenate(kept),
        stiffness=None if field.stiffness is None else field.stiffness[used],
        rig_arrays=reduced_rig(field.rig_arrays, used),
    )


def coarsest(field: TetField, count: int) -> TetField:
    """The field with its `count` coarsest levels alone, as if the features of others were 0.

    Raises:
        ValueError: It has fewer levels, or none would be left.
    """
    if not 1 <= count <= field.options.level_count:
        raise ValueError(f"{count} levels of {field.options.level_count} can't be kept")
    layout, ((weights, bias), *others) = field.layout, field.density_layers
    dense = min(count, layout.dense_level_count)
    return replace(
        field,
        options=replace(field.options, level_count=count),
        layout=Layout(layout.entry_counts[:count], dense, layout.node_ids[:dense]),
        table=field.table[: layout.offsets[count]],
        density_layers=((weights[: count * FEATURES], bias), *others),
    )


def cut(field: TetField, box: ArrayLike, keep_inside: bool = True) -> TetField:
    """The field inside a box, or outside of it, cut at the sub-tets whose middles lie there.

    Args:
        box: Lowest and highest corner, model space.  [2, 3]

    Raises:
        ValueError: Nothing is left.
    """
    middles = subtet_middles(field.mesh)
    stays = ((middles >= box[0]) & (middles <= box[1])).all(axis=2) == keep_inside
    matter = unpack_mask(field.occupancy) & stays
    if not matter.any():
        raise ValueError("nothing of the model would be left: take another box")
    return reduced(replace(field, occupancy=pack_mask(matter)), stays.any(axis=1))


def nearer_to_matter(neighbours: np.ndarray, matter: np.ndarray, gone: np.ndarray) -> np.ndarray:
    """The tets that stay when matter has gone: those with some, and the empty ones near it.

    An empty tet keeps an object solid.  It goes with the matter that it is nearest to, counted
    in steps through faces; where both are as near, it stays.

    Args:
        neighbours: The tet across each face, or -1.  [T, 4]
        matter: Tets with matter left.  [T] bool
        gone: Tets all of whose matter has gone.  [T] bool

    Returns:
        [T] bool
    """
    left, lost = matter.copy(), gone & ~matter
    while True:
        free = ~(left | lost)
        to_left, to_lost = (_beside(neighbours, of) & free for of in (left, lost))
        if not (to_left.any() or to_lost.any()):
            return ~lost
        left |= to_left
        lost |= to_lost & ~to_left


def specks(field: TetField, share: float = SPECK) -> np.ndarray:
    """Which tets with matter belong to parts that `without_specks` takes away.  [T] bool"""
    matter = unpack_mask(field.occupancy)
    occupied = matter.any(axis=1)
    return occupied & ~_large(field, matter, occupied, share) if occupied.any() else occupied


def without_specks(field: TetField, share: float = SPECK) -> TetField:
    """The field without its connected parts that have less than that share of the matter.

    Matter is counted in occupied sub-tets; parts are connected through faces of tets that have
    some.  The largest part stays in any case.
    """
    matter = unpack_mask(field.occupancy)
    if not matter.any():
        return field
    goes = specks(field, share)
    # Empty tets stay, unless everything that they are joined with goes.
    keep = ~goes & _large(field, matter * ~goes[:, None], np.ones(len(goes), bool), share)
    return field if keep.all() else reduced(field, keep)


def _beside(neighbours, tets):
    """Whether a face of each tet is one of these tets', [T] bool.  [T] bool"""
    return (tets[neighbours] & (neighbours >= 0)).any(axis=1)


def _large(field, matter, among, share):
    """Which tets belong to a part, of the tets `among`, that has that share of the matter.  [T]"""
    labels = face_components(field.neighbours, among)
    sizes = np.bincount(labels[among], matter.sum(axis=1)[among])
    large = sizes >= share * matter.sum()
    large[sizes.argmax()] = True
    return among & large[labels]


def _entries(field, mesh, level, keep):
    """The entries of the field's level at the nodes of the tets in `mesh`, those kept.  [T', n]"""
    if level < field.layout.dense_level_count:
        return field.layout.node_ids[level][keep]
    nodes, _ = path_nodes(level)
    corners = mesh.addresses[mesh.tets].astype(np.int64)
    addresses = np.einsum("nc,tcx->tnx", nodes, corners)
    return hash_address(addresses, field.layout.entry_counts[level])
