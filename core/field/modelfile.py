"""model.npz <-> TetField.  docs/model-format.md describes the format field by field.

A file is checked before a field is built: archive.py checks the zip and its arrays, meta.py
the text that describes them, packing.py mesh, tables and networks.
"""

from pathlib import Path

import numpy as np

from ..geometry import tet_neighbours
from ..paths import whole_file
from .archive import ModelFileError, check, read_arrays
from .field import TetField, layer_widths
from .layout import make_layout
from .meta import meta_text, read_meta, read_options, read_training
from .packing import (
    pack_layers,
    pack_mesh,
    pack_surroundings,
    pack_tables,
    unpack_layers,
    unpack_mesh,
    unpack_surroundings,
    unpack_tables,
)
from .reach import reached_entries

LONGEST_MESSAGE = 300  # characters: a damaged file may have anything as a value


def save(field: TetField, path, metadata_: dict | None = None, entry_bits=16):
    """Write a field; the file appears only when it is complete.

    Entries that nothing reaches are left out and the others rounded, to half precision or
    to one byte with a scale per level and feature; `load` returns what is left.

    Args:
        entry_bits: 16 or 8, per feature of an entry.
    """
    path = Path(path)
    arrays = pack(field, metadata_, entry_bits)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as partial, open(partial, "wb") as stream:
        np.savez(stream, **arrays)


def pack(field: TetField, metadata_: dict | None = None, entry_bits=16) -> dict:
    """The arrays that `save` writes."""
    arrays, spacing = pack_mesh(field.mesh, field.occupancy)
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    arrays |= pack_tables(field.table, field.layout, reached, entry_bits)
    arrays |= pack_layers("density", field.density_layers)
    arrays |= pack_layers("color", field.color_layers)
    if field.surroundings:
        arrays |= pack_surroundings(field.surroundings)
    meta = meta_text(field, spacing, {**field.meta, **(metadata_ or {})})
    return arrays | {"meta": np.frombuffer(meta.encode(), np.uint8)}


def load(path) -> TetField:
    """Read and check a model file.

    Raises:
        ModelFileError: The file is missing, is no model, has another version or is damaged.
    """
    path = Path(path)
    arrays = read_arrays(path)
    try:
        return _build(arrays)
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {_one_line(error)}") from error
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise ModelFileError(f"{path} is damaged: {_one_line(error)}") from error


def _one_line(error) -> str:
    line = " ".join(str(error).split())
    return line if len(line) <= LONGEST_MESSAGE else line[:LONGEST_MESSAGE] + " ..."


def _build(arrays) -> TetField:
    meta = read_meta(arrays["meta"].tobytes().decode())
    options = read_options(meta["options"])
    # Version 1 has no lattice spacing: it stores every rest vertex.
    mesh, occupancy = unpack_mesh(arrays, meta.get("lattice_spacing"), options.level_count)
    layout = make_layout(mesh, options.level_count, options.table_size, options.dense_levels)
    check(
        list(layout.entry_counts) == meta["entry_counts"]
        and layout.dense_level_count == meta["dense_level_count"],
        f"its levels should have {list(layout.entry_counts)} entries, "
        f"{layout.dense_level_count} of them dense; "
        f"it declares {meta['entry_counts']}, {meta['dense_level_count']} of them dense",
    )
    world_to_model = np.array(meta["world_to_model"], float)
    check(
        world_to_model.shape == (4, 4) and np.isfinite(world_to_model).all(),
        "its 'world_to_model' is no 4x4 matrix",
    )
    table = unpack_tables(arrays, layout)
    density, color = layer_widths(options)
    return TetField(
        mesh=mesh,
        neighbours=tet_neighbours(mesh.tets),
        occupancy=occupancy,
        layout=layout,
        table=table,
        density_layers=unpack_layers(arrays, "density", density),
        color_layers=unpack_layers(arrays, "color", color),
        options=options,
        world_to_model=world_to_model,
        meta=read_training(meta.get("training")),
        surroundings=unpack_surroundings(arrays),
    )
