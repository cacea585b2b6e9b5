"""Where each level's entries are in the table of features.

If all vertices of a level fit in its table, the level is dense: each vertex has its own entry,
whose index is the rank of the vertex's address in lexicographic order.  All other levels are
hashed, as in Instant-NGP (Müller et al. 2022, Eq. 4):
(x·1) xor (y·2654435761) xor (z·805459861) in uint32, masked to a table of 2^n entries.

Shapes: T tets, L levels, D of them dense, F = 4 features per entry, n_l nodes of a tet (the
corners of all its descendants) at level l.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..definition.encoding import FEATURES as FEATURES
from ..definition.encoding import PRIMES, Encoding
from ..geometry import TetMesh, path_nodes

MOST_ENTRIES = 2**27  # 2 GiB in float32; a full-size model has about 2^21
_PRIME_Y, _PRIME_Z = (wp.constant(wp.uint32(prime)) for prime in PRIMES[1:])
MAX_DENSE_LEVELS = 4  # beyond, the id table would outweigh the features


@dataclass(frozen=True)
class Layout:
    """The places of each level's entries in the table."""

    entry_counts: tuple[int, ...]  # [L] per level; a power of two where hashed
    dense_level_count: int  # levels 0..D-1 are dense
    node_ids: tuple[np.ndarray, ...]  # D x [T, n_l] the entry of each node of each tet

    @property
    def level_count(self) -> int:
        return len(self.entry_counts)

    @property
    def offsets(self):
        """First entry of each level, and the total.  [L + 1]"""
        return np.concatenate([[0], np.cumsum(self.entry_counts)]).astype(np.int64)


def dense_ids(mesh: TetMesh, level: int):
    """Rank of every level-`level` vertex among all, in lexicographic order of address.

    Returns:
        ids [T, n] int32 for the nodes of `path_nodes(level)`, and the number of vertices.
    """
    nodes, _ = path_nodes(level)
    corners = mesh.addresses[mesh.tets].astype(np.int64)  # [T, 4, 3]
    addresses = np.einsum("nc,tcx->tnx", nodes, corners)
    key = (addresses[..., 0] << 42) | (addresses[..., 1] << 21) | addresses[..., 2]
    unique, ids = np.unique(key, return_inverse=True)
    return ids.reshape(key.shape).astype(np.int32), len(unique)


def make_layout(mesh: TetMesh, level_count: int, table_size: int, dense_levels=True) -> Layout:
    """Dense levels as long as their vertices fit `table_size`, hashed levels above.

    Args:
        table_size: Entries of a hashed level, a power of two.
        dense_levels: If false, all levels are hashed.

    Raises:
        ValueError: level_count is outside 1..10 or table_size is no power of two.
    """
    if not 1 <= level_count <= 10:
        raise ValueError(f"level_count is {level_count}; give 1 to 10")
    if table_size < 2 or table_size & (table_size - 1):
        raise ValueError(f"the table size {table_size} is not a power of two")
    entry_counts, node_ids = [], []
    for level in range(min(level_count, MAX_DENSE_LEVELS) if dense_levels else 0):
        # A tet has at least 8^l / 6 vertices of its own, so larger levels needn't be counted.
        if mesh.tet_count * 8**level > 8 * table_size:
            break
        ids, count = dense_ids(mesh, level)
        if count > table_size:
            break
        entry_counts.append(count)
        node_ids.append(ids)
    dense = len(entry_counts)
    entry_counts += [table_size] * (level_count - dense)
    return Layout(tuple(entry_counts), dense, tuple(node_ids))


def encoding_of(mesh: TetMesh, layout: Layout, table: np.ndarray) -> Encoding:
    """The same for core/definition, in the table's precision.  [entries, F]"""
    return Encoding(
        corner_addresses=mesh.addresses[mesh.tets].astype(np.int64),
        tables=tuple(np.split(table, layout.offsets[1:-1])),
        dense_entries=tuple(
            ids[:, path_nodes(level)[1]] for level, ids in enumerate(layout.node_ids)
        ),
    )


def node_table(layout: Layout, table: np.ndarray) -> np.ndarray:
    """The dense levels' entries for each node of each tet, in the order of `Tables.node_ids`.

    Tets that share a node repeat its entry.  That takes as much memory as the ids and saves
    a load that depends on another one.  [entries, F] -> [nodes, F]
    """
    starts = layout.offsets
    levels = [table[starts[k] + ids.ravel()] for k, ids in enumerate(layout.node_ids)]
    return np.concatenate([*levels, np.zeros((1, table.shape[1]), table.dtype)])


def hash_products(addresses):
    """Coordinates times their primes, linear in the address modulo 2^32.

    [..., 3] int -> [..., 3] uint32
    """
    return np.asarray(addresses).astype(np.uint32) * np.array(PRIMES, np.uint32)


@wp.func
def products_entry(products: wp.vec3ui, mask: int):
    """Entry of the address with these `hash_products`."""
    return int((products[0] ^ products[1] ^ products[2]) & wp.uint32(mask))


@wp.func
def hash_entry(address: wp.vec3i, mask: int):
    """Entry of an address in a table of mask + 1 entries, a power of two."""
    y = wp.uint32(address[1]) * _PRIME_Y
    z = wp.uint32(address[2]) * _PRIME_Z
    return products_entry(wp.vec3ui(wp.uint32(address[0]), y, z), mask)
