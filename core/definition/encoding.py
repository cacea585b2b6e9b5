"""The recursive tetrahedral encoding: it maps a point to a vector of features.

    L                          levels; level 0 is the coarse mesh
    tables    L × [E_l, F]     features of the vertices of each level; F = 4
    entry                      row of a vertex in the table of its level
    features  [N, L F]         of points

At each level the descendant that holds the point has four corners, each with a row in the table.
The rows are interpolated with the point's coordinates in the descendant, α, α', ...; the results of
all levels are concatenated (DeformRF, section 3.2, Eq. 4):

    features = (Σ_j α_j table_0[entry_j], Σ_j α'_j table_1[entry'_j], ...)

The entry follows from the rest address of the corner:

    dense     its rank among the addresses of all vertices of the level, by x, then y, then z
    hashed    (x · 1 xor y · 2654435761 xor z · 805459861) mod 2³² mod E_l, with E_l = 2^n
              (Instant-NGP, Müller et al. 2022, Eq. 4)

The coarsest levels are dense.  Deformation moves vertices and leaves addresses as they are: that is
all there is to a deformed radiance field.
"""

from dataclasses import dataclass

import numpy as np

from .subdivision import child_addresses, descend

FEATURES = 4  # F
PRIMES = 1, 2654435761, 805459861


@dataclass(frozen=True)
class Encoding:
    """The features of all levels, and where the vertices of each have theirs."""

    corner_addresses: np.ndarray  # [T, 4, 3] int, of the coarse tets
    tables: tuple[np.ndarray, ...]  # L × [E_l, F]
    dense_entries: tuple[np.ndarray, ...]  # of the dense levels, [T, 8^l, 4] int each


def dense_entries(corner_addresses, level):
    """The entry of each corner of each descendant, by path, in a dense level.  [T, 8^l, 4] int"""
    corners = corner_addresses.astype(np.int64)
    for _ in range(level):
        tets, k = np.repeat(corners, 8, axis=0), np.tile(np.arange(8), len(corners))
        corners = child_addresses(tets, k)
    x, y, z = corners.reshape(len(corner_addresses), -1, 4, 3).transpose(3, 0, 1, 2)
    keys = (x << 42) | (y << 21) | z  # in the order of addresses, which are below 2²¹
    return np.unique(keys, return_inverse=True)[1].reshape(keys.shape)


def hash_address(addresses, entry_count):
    """Entries in a table of 2^n entries.  [..., 3] int -> [...] int64"""
    products = np.asarray(addresses).astype(np.uint32) * np.array(PRIMES, np.uint32)
    hashed = products[..., 0] ^ products[..., 1] ^ products[..., 2]
    return (hashed & np.uint32(entry_count - 1)).astype(np.int64)


def encode(encoding: Encoding, tet, alpha):
    """Features of points: their coarse tets [N] and α in them [N, 4].  [N, L F]"""
    corners, path = encoding.corner_addresses[tet], np.zeros(len(tet), np.int64)
    features = []
    for level, table in enumerate(encoding.tables):
        if level > 0:
            k, alpha = descend(alpha)
            path, corners = 8 * path + k, child_addresses(corners, k)
        if level < len(encoding.dense_entries):
            entries = encoding.dense_entries[level][tet, path]
        else:
            entries = hash_address(corners, len(table))
        features.append(np.einsum("nc,ncf->nf", alpha, table[entries]))
    return np.concatenate(features, axis=1)
