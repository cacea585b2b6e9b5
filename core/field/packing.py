"""A field's mesh, tables and networks <-> the arrays of a model file.

The reader does not trust a file.  `declared` checks an array's name, type and shape before its
values are read (`core.base.schema`).  `array` reads the values and checks that they are finite.
Every error is a FileError of one sentence.

docs/model-format.md describes the arrays.  The file stores nothing that can be computed from the
rest of it:

- Rest vertices of a lattice follow from their addresses.
- Integers take 16 bits where they fit.
- Entries that no occupied sub-tet reaches (reach.py) are left out and read as 0; bit e of
  `reached_l` is 1 if `table_l` contains entry e.  If a level's bits would take more space than
  the entries that they save, the level is stored whole, without bits.
- Entries are float16, or int8 with a scale per level and feature: value = scale · integer,
  scale = max |value| / 127, so an error is at most scale / 2.  (Clipping the largest
  values would gain 0.2 dB of 61 on the bundled model, and lose that bound.)  Errors of the
  coarsest levels cost the most, and these have the fewest entries, so they stay float16:
  `wide_levels`.
- If each ray has one color, the color network has many weights.  They are float16 then: GPUs
  compute with float16 weights anyway.

Shapes: V vertices, T tets, F features per entry.
"""

from itertools import pairwise

import numpy as np

from ..base.schema import array, check, declared
from ..geometry import TetMesh, lattice_spacing, lattice_vertices
from .bounds import LARGEST_WEIGHT
from .grid import GRID_ENTRIES, GRID_LEVELS, Surroundings, surroundings_widths
from .layout import FEATURES, MOST_ENTRIES, Layout

ENTRY_BITS = (8, 16)
ENTRY_TYPES = (np.float16, np.int8)
LARGEST_INT8 = 127
EXACT = 1e-4  # of a scale: roundings of float32
WIDE_SHARE = 1 / 16  # of all stored entries, that may be float16 among int8
STIFFNESS_RANGE = 1e-3, 1e3
LARGEST_SCALE = 1e3  # values then reach as far as float16's
INTEGERS = (np.uint16, np.int32)
RIG_FRAMES = "rig_frames_"


def pack_mesh(mesh: TetMesh, occupancy):
    """The mesh's arrays, and its lattice spacing; None if they hold the rest vertices."""
    arrays = {
        "addresses": _shortened(mesh.addresses),
        "tets": _shortened(mesh.tets),
        "occupancy": occupancy.astype(np.uint64),
    }
    spacing = lattice_spacing(mesh)
    if spacing is None:
        arrays["rest_vertices"] = mesh.rest_vertices.astype(np.float64)
    return arrays, spacing


def unpack_mesh(arrays, spacing, level_count: int):
    """The mesh and its occupancy, checked; see `pack_mesh`."""
    addresses = array(arrays, "addresses", INTEGERS, (None, 3)).astype(np.int32)
    vertex_count = len(addresses)
    limit = 2**20 >> (level_count - 1)
    check(
        vertex_count > 0 and addresses.min() >= 0 and addresses.max() < limit,
        f"'addresses' is empty or leaves 0..{limit - 1}",
    )
    if spacing is None:
        rest_vertices = array(arrays, "rest_vertices", np.float64, (vertex_count, 3))
    else:
        check(0.0 < spacing < 1.0, f"its lattice spacing is {spacing}, not between 0 and 1")
        rest_vertices = lattice_vertices(addresses, spacing)
    tet_count = declared(arrays, "tets", INTEGERS, (None, 4)).shape[0]
    declared(arrays, "occupancy", np.uint64, (tet_count,))
    tets = array(arrays, "tets", INTEGERS, (None, 4)).astype(np.int32)
    check(len(tets) > 0, "it has no tets")
    check(
        tets.min() >= 0 and tets.max() < vertex_count,
        f"'tets' names vertices outside 0..{vertex_count - 1}",
    )
    occupancy = array(arrays, "occupancy", np.uint64, (len(tets),))
    return TetMesh(rest_vertices, addresses, tets), occupancy


def pack_tables(table, layout: Layout, reached, entry_bits=16, wide: int | None = None):
    """The arrays of a table [entries, F] of which `reached` [entries] is stored.

    Args:
        wide: How many coarse levels stay float16 among int8, unless int8 holds them exactly; by
            default `wide_levels`.

    Raises:
        ValueError: entry_bits is neither 16 nor 8.
    """
    if entry_bits not in ENTRY_BITS:
        raise ValueError(f"the entries can't have {entry_bits} bits; give 8 or 16")
    arrays, offsets = {}, layout.offsets
    if entry_bits == 16:
        wide = layout.level_count
    elif wide is None:
        wide = wide_levels(layout, reached)
    for level, entry_count in enumerate(layout.entry_counts):
        entries = slice(offsets[level], offsets[level + 1])
        values, kept = table[entries], reached[entries]
        bits = np.packbits(kept)
        is_wide = level < wide and not (entry_bits == 8 and in_steps(values[kept]))
        if (entry_count - kept.sum()) * FEATURES * (1 + is_wide) > len(bits):
            arrays[f"reached_{level}"] = bits
            values = values[kept]
        if is_wide:
            arrays[f"table_{level}"] = values.astype(np.float16)
        else:
            arrays[f"table_{level}"], arrays[f"scale_{level}"] = quantize(values)
    return arrays


def wide_levels(layout: Layout, reached) -> int:
    """How many levels, the coarsest ones, have only WIDE_SHARE of the entries `reached` [entries].

    Their roundings to int8 make most of what all cost: of *mic* .037 of .039 dB, of *chair* .031 of
    .037.
    """
    counts = np.add.reduceat(reached.astype(np.int64), layout.offsets[:-1])
    return int((np.cumsum(counts) <= WIDE_SHARE * counts.sum()).sum())


def check_tables(arrays, entry_counts) -> None:
    """Whether the tables in the file are as large as levels of so many entries need.

    It reads none of them, so a small file can't ask for many entries.
    """
    total = sum(entry_counts)
    check(total <= MOST_ENTRIES, f"it has {total} entries, more than {MOST_ENTRIES}")
    for level, entry_count in enumerate(entry_counts):
        table = declared(arrays, f"table_{level}", ENTRY_TYPES, (None, FEATURES))
        stored_count = table.shape[0]
        if f"reached_{level}" in arrays:
            declared(arrays, f"reached_{level}", np.uint8, (-(-entry_count // 8),))
        else:
            check(
                stored_count == entry_count,
                f"'table_{level}' holds {stored_count} entries, but the level has {entry_count}",
            )


def unpack_tables(arrays, layout: Layout):
    """The table, checked; 0 where an entry is not stored.  [entries, F] float32"""
    check_tables(arrays, layout.entry_counts)
    total = sum(layout.entry_counts)
    table = np.zeros((total, FEATURES), np.float32)
    for level, entry_count in enumerate(layout.entry_counts):
        name = f"table_{level}"
        stored_count, kept = entry_count, slice(None)
        if f"reached_{level}" in arrays:
            kept = _unpack_bits(arrays, f"reached_{level}", entry_count)
            stored_count = int(kept.sum())
        values = array(arrays, name, ENTRY_TYPES, (None, FEATURES))
        check(
            len(values) == stored_count,
            f"'{name}' holds {len(values)} entries, but 'reached_{level}' marks {stored_count}",
        )
        if values.dtype == np.int8:
            scale = array(arrays, f"scale_{level}", np.float32, (FEATURES,))
            check(
                0.0 <= scale.min() and scale.max() <= LARGEST_SCALE,
                f"'scale_{level}' leaves 0..{LARGEST_SCALE:g}",
            )
            values = values * scale
        table[layout.offsets[level] : layout.offsets[level + 1]][kept] = values
    return table


def stored_bits(arrays, level_count: int) -> int:
    """Of the numbers in the file's tables: those of the finest level, which has the most."""
    return 8 if arrays[f"table_{level_count - 1}"].dtype == np.int8 else 16


def pack_layers(name, layers, half=False) -> dict:
    """A network's arrays; `half`: weights in half precision, if it can hold them."""
    arrays = {}
    for i, (weights, bias) in enumerate(layers):
        fits = half and np.abs(weights).max(initial=0.0) <= LARGEST_WEIGHT
        arrays[f"{name}_weights_{i}"] = weights.astype(np.float16 if fits else np.float32)
        arrays[f"{name}_bias_{i}"] = bias.astype(np.float32)
    return arrays


def unpack_layers(arrays, name, widths, half=False):
    """A network's layers in float32, checked against its widths; see `pack_layers`."""
    kinds = (np.float32, np.float16) if half else np.float32
    return tuple(
        (
            array(arrays, f"{name}_weights_{i}", kinds, (rows, columns)).astype(np.float32),
            array(arrays, f"{name}_bias_{i}", np.float32, (columns,)),
        )
        for i, (rows, columns) in enumerate(pairwise(widths))
    )


def pack_surroundings(surroundings: Surroundings) -> dict:
    return {
        "surroundings_box": surroundings.box.astype(np.float64),
        "surroundings_table": surroundings.table.astype(np.float16),
        "surroundings_sky": surroundings.sky.astype(np.float32),
        **pack_layers("surroundings_density", surroundings.density_layers),
        **pack_layers("surroundings_color", surroundings.color_layers),
    }


def unpack_stiffness(arrays, vertex_count):
    """The factors of Young's modulus [V], checked; None if the file has none."""
    if "stiffness" not in arrays:
        return None
    factors = array(arrays, "stiffness", np.float16, (vertex_count,)).astype(np.float32)
    low, high = STIFFNESS_RANGE
    check(((low <= factors) & (factors <= high)).all(), f"'stiffness' leaves {low:g}..{high:g}")
    return factors


def unpack_surroundings(arrays) -> Surroundings | None:
    """The surroundings, checked; None if the file has none."""
    if "surroundings_table" not in arrays:
        return None
    density, color = surroundings_widths()
    box = array(arrays, "surroundings_box", np.float64, (2, 3))
    check((box[0] < box[1]).all(), "'surroundings_box' is empty")
    shape = (GRID_LEVELS * GRID_ENTRIES, FEATURES)
    return Surroundings(
        box,
        array(arrays, "surroundings_table", np.float16, shape).astype(np.float32),
        unpack_layers(arrays, "surroundings_density", density),
        unpack_layers(arrays, "surroundings_color", color),
        array(arrays, "surroundings_sky", np.float32, (3,)),
    )


def quantize(values):
    """int8 [n, F] and scale float32 [F] with values ≈ scale · integers, to scale / 2."""
    scale = (np.abs(values).max(axis=0, initial=0.0) / LARGEST_INT8).astype(np.float32)
    divisor = np.where(scale > 0.0, scale, np.float32(1.0))
    return np.rint(values / divisor).astype(np.int8), scale


def in_steps(values) -> bool:
    """Whether all values [n, F] are integers times the scale of `quantize`, but for roundings."""
    integers, scale = quantize(values)
    return not (np.abs(integers * scale - values) > EXACT * scale).any()


def _shortened(integers):
    fits = 0 <= integers.min() and integers.max() < 2**16
    return integers.astype(np.uint16 if fits else np.int32)


def _unpack_bits(arrays, name, count):
    packed = array(arrays, name, np.uint8, (-(-count // 8),))
    bits = np.unpackbits(packed).astype(bool)
    check(not bits[count:].any(), f"'{name}' marks entries beyond the level's {count}")
    return bits[:count]


def unpack_rig(arrays, vertex_count: int) -> dict | None:
    """The arrays of a rig, None without one; wings/rig/rigfile.py checks what they hold."""
    names = [name for name in arrays if name.startswith("rig_")]
    for name in names:
        if name == "rig_weights":
            declared(arrays, name, np.float32, (vertex_count, None))
        elif name == "rig_weight_bones":
            declared(arrays, name, np.uint16, (vertex_count, None))
        elif name == "rig_offsets":
            declared(arrays, name, np.float32, (vertex_count, None, 3))
        elif name.startswith(RIG_FRAMES):
            declared(arrays, name, np.float32, (None, vertex_count, 3))
    return {name: np.asarray(arrays[name]) for name in names} or None


def reduced_rig(arrays: dict | None, used) -> dict | None:
    """A rig's arrays for the vertices `used` alone."""
    if arrays is None:
        return None
    rows = ("rig_weights", "rig_weight_bones", "rig_offsets")
    arrays = {name: a[used] if name in rows else a for name, a in arrays.items()}
    return {n: a[:, used] if n.startswith(RIG_FRAMES) else a for n, a in arrays.items()}
