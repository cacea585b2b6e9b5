"""model.npz <-> TetField.  docs/model-format.md describes the format field by field.

A file is checked before a field is built (packing.py).  The entry `meta` is JSON text.  Its keys
that fix the field's shape have to be right.  Its entry `training` only says where a model comes
from: the reader keeps what has the documented type there and drops the rest, as any key may be
missing.
"""

import json
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np

from ..geometry import tet_neighbours
from ..paths import program_version, whole_file
from .field import FieldOptions, TetField, layer_widths
from .layout import FEATURES, MOST_ENTRIES, make_layout
from .packing import (
    ModelFileError,
    check,
    pack_layers,
    pack_mesh,
    pack_surroundings,
    pack_tables,
    read_arrays,
    unpack_layers,
    unpack_mesh,
    unpack_stiffness,
    unpack_surroundings,
    unpack_tables,
)
from .reach import reached_entries

FORMAT = "deformrf-model"
FORMAT_VERSION = 2
READABLE_VERSIONS = (1, 2)
ACTIVATION = "relu"  # older programs could train density networks with "sigmoid" as well
SMALLEST_MARCH_STEP = 1e-4  # a finer one would take a ray through a million pieces
HISTORY_KEYS = ("seconds", "stage", "step", "psnr")
TRAINING_TYPES = {
    "data": str,
    "device": str,
    "diverged": str,
    "interrupted": bool,
    "seconds": float,
    "stage_1_seconds": float,
    "size": float,
    "occupied_share": float,
    "workers": int,
    "view_count": int,
    "missing_images": int,
    "test_view_count": int,
    "tet_count": int,
    "stage_1_tet_count": int,
    "options": dict,
    "history": list,
    "image_size": list,
    "test_mean": dict,
    "peak_memory_bytes": list,
    "levels_below_pixel": list,
}
NUMBER_LISTS = ("image_size", "peak_memory_bytes", "levels_below_pixel")
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
    if field.stiffness is not None:
        arrays["stiffness"] = field.stiffness.astype(np.float16)
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
        stiffness=unpack_stiffness(arrays, mesh.vertex_count),
    )


def meta_text(field: TetField, lattice_spacing: float | None, training: dict) -> str:
    """The values of a model file's `meta`."""
    return json.dumps(
        {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "program_version": program_version(),
            "options": asdict(field.options) | {"density_activation": ACTIVATION},
            "feature_count": FEATURES,
            "dense_level_count": field.layout.dense_level_count,
            "entry_counts": list(field.layout.entry_counts),
            "lattice_spacing": lattice_spacing,
            "world_to_model": field.world_to_model.tolist(),
            "training": training,
        }
    )


def read_meta(text: str) -> dict:
    """The values of a `meta` entry of a version that this program reads.

    Raises:
        ModelFileError, or ValueError if it is no JSON.
    """
    try:
        meta = json.loads(text)
    except RecursionError:
        check(False, "its 'meta' nests too deeply")
    check(
        isinstance(meta, dict) and meta.get("format") == FORMAT,
        "it is not a deformrf model: its 'meta' names no such format",
    )
    version = meta.get("format_version")
    check(
        version in READABLE_VERSIONS,
        f"it has format version {version}, "
        f"this program reads {' and '.join(map(str, READABLE_VERSIONS))}",
    )
    check(
        meta["feature_count"] == FEATURES,
        f"it has {meta['feature_count']} features per entry, this program reads {FEATURES}",
    )
    return meta


def read_options(values: dict) -> FieldOptions:
    """The field's options, checked."""
    values = dict(values)
    activation = values.pop("density_activation", ACTIVATION)
    check(
        activation == ACTIVATION,
        f"its density network has the activation '{activation}', this program reads {ACTIVATION}",
    )
    for name in ("density_hidden", "color_hidden"):
        values[name] = tuple(values[name])
    options = FieldOptions(**values)
    for option in fields(options):
        if option.type in (int, bool):
            value = getattr(options, option.name)
            check(type(value) is option.type, f"its option '{option.name}' is {value!r}")
    check(1 <= options.level_count <= 10, f"it has {options.level_count} levels, not 1 to 10")
    check(
        options.table_size <= MOST_ENTRIES,
        f"its tables have {options.table_size} entries, more than {MOST_ENTRIES}",
    )
    check(
        SMALLEST_MARCH_STEP <= options.march_step < 1.0,
        f"its march step is {options.march_step}, below {SMALLEST_MARCH_STEP} or above 1",
    )
    return options


def read_training(values) -> dict:
    """The facts on a model's training; entries of a wrong type are dropped."""
    if not isinstance(values, dict):
        return {}
    known = {
        key: value
        for key, value in values.items()
        if key not in TRAINING_TYPES or _has_type(value, TRAINING_TYPES[key])
    }
    if "history" in known:
        known["history"] = [row for row in known["history"] if _is_history_row(row)]
    if "test_mean" in known:
        scores = known["test_mean"].items()
        known["test_mean"] = {name: score for name, score in scores if _has_type(score, float)}
    for key in NUMBER_LISTS:
        if not all(_has_type(value, float) for value in known.get(key, ())):
            del known[key]
    return known


def _has_type(value, kind) -> bool:
    """Whether a JSON value is of a kind; numbers (float) are finite and below 2^63."""
    if kind is float:
        return type(value) in (int, float) and abs(value) < 2**63
    return type(value) is kind


def _is_history_row(row) -> bool:
    numbers = isinstance(row, dict) and all(_has_type(row.get(k), float) for k in HISTORY_KEYS)
    return numbers and row["seconds"] > 0 and row["stage"] in (1, 2)
