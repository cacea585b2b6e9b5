"""A table of features in bytes for the CPU, a quarter of the usual size: more fits in the caches.

An entry of 8 bits in a file is an integer times a scale per level and feature (packing.py).  On a
CPU the table keeps the integers, four to a word.  The scales are multiplied into the weights of the
density network's first layer.  For dense levels the table stores an entry for each node of each tet
(`node_table`), so a sample needs no vertex ids.  The coarsest levels, which have 16 bits in the
file, are read from the table of floats.

Shapes: L levels, F = 4 features.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .layout import FEATURES, Layout, node_table
from .packing import in_steps, quantize


@dataclass(frozen=True)
class ByteTable:
    """A table in bytes.

    Attributes:
        words: Entries of the nodes in the order of `Tables.node_ids`, then those of the hashed
            levels; feature f is the signed byte f of the little-endian word.  int32
        hashed_start: What to add to an entry of a hashed level for its place in `words`.
        scales: Of the features; 1 in levels of floats.  [L · F] float32
        first_level: The coarsest level in bytes.
    """

    words: np.ndarray
    hashed_start: int
    scales: np.ndarray
    first_level: int


def table_in_bytes(layout: Layout, table: np.ndarray) -> ByteTable | None:
    """The table [entries, F] in bytes, from the level on whose numbers all are integers times a
    scale; None if not even those of the finest level are.
    """
    assert table.shape[1] == FEATURES == 4, "a word has four bytes"
    integers, scales, first_level = np.zeros(table.shape, np.int8), [], 0
    for level, (first, end) in enumerate(pairwise(layout.offsets)):
        integers[first:end], scale = quantize(table[first:end])
        if not in_steps(table[first:end]):
            first_level = level + 1
        scales.append(scale)
    if first_level == layout.level_count:
        return None
    scales[:first_level] = [np.ones(FEATURES, np.float32)] * first_level
    nodes = node_table(layout, integers)
    hashed = layout.offsets[layout.dense_level_count]
    words = np.concatenate([nodes, integers[hashed:]]).view("<i4").ravel()
    return ByteTable(words, len(nodes) - int(hashed), np.concatenate(scales), first_level)
