"""model.npz <-> TetField.  docs/model-format.md describes the format field by field.

A file is checked before a field is built (packing.py).  The entry `meta` is JSON text.  Keys of
`meta` that determine the field's shape must be correct.  Its key `training` only describes where
the model comes from: the reader keeps values of the documented types and drops all others, and any
of them may be missing.
"""

import json
import zipfile
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..base.archive import one_sentence, open_archive, unpacked_limit
from ..base.paths import is_project, program_version, whole_file
from ..base.schema import (
    FileError,
    array,
    by_name,
    check,
    declared,
    flag,
    integer,
    listing,
    mapping,
    number,
    optional,
    text,
    vector,
)
from ..base.streams import printable, shown
from ..geometry import tet_neighbours
from .bounds import (
    SMALLEST_MARCH_STEP,
    check_geometry,
    check_levels,
    check_weights,
    check_widths,
    check_work,
    check_world,
)
from .field import FieldOptions, TetField, layer_widths
from .layout import FEATURES, MOST_ENTRIES, make_layout
from .packing import (
    INTEGERS,
    check_tables,
    pack_layers,
    pack_mesh,
    pack_surroundings,
    pack_tables,
    stored_bits,
    unpack_layers,
    unpack_mesh,
    unpack_rig,
    unpack_stiffness,
    unpack_surroundings,
    unpack_tables,
)
from .reach import reached_entries

FORMAT = "deformrf-model"
READABLE_VERSIONS = (1, 2, 3)
SAMPLE_COLOR_VERSION, RAY_COLOR_VERSION = 2, 3  # the first that know such fields
ACTIVATION = "relu"  # older programs could train density networks with "sigmoid" as well
LONGEST_META = 2**20  # bytes; ours has some 30,000
LONGEST_LINE = 2000  # characters of a text on the training
MESH_ARRAYS = ("rest_vertices", "addresses", "tets", "occupancy")
TABLE_ARRAYS = ("table_", "reached_", "scale_")
HISTORY_KEYS = ("seconds", "stage", "step", "psnr")
# Of a file alone: the model of which it has all, as training wrote it.  A copy may be edited.
WHOLE_OF = "whole_of"
SHOWN = "data", "device", "diverged", "attribution"  # in windows and terminals
FINITE = number(-(2.0**63), 2.0**63)
ANGLES = optional(mapping({"median": FINITE, "largest": FINITE}))
SCORES = mapping({"view_count": integer(), "mean": by_name(optional(FINITE)), "angles": ANGLES})
TRAINING = {  # what is known of a training: whether a value of the file is one
    **dict.fromkeys((*SHOWN, WHOLE_OF), text()),
    **dict.fromkeys(("interrupted", "object_stands"), flag),
    **dict.fromkeys(("seconds", "stage_1_seconds", "size"), FINITE),
    **dict.fromkeys(("object_slack", "occupied_share", "depth_gain", "decay_gain"), FINITE),
    **dict.fromkeys(("workers", "view_count", "missing_images", "test_view_count"), integer()),
    **dict.fromkeys(("tet_count", "stage_1_tet_count", "returns", "levels_left_out"), integer()),
    **dict.fromkeys(("image_size", "peak_memory_bytes"), listing(FINITE)),
    "views": listing(vector(16, FINITE)),
    **dict.fromkeys(("object_box", "history"), lambda value: isinstance(value, list)),
    **dict.fromkeys(("options", "test_mean", "sector"), lambda value: isinstance(value, dict)),
    "test_angles": ANGLES,
    "sector_scores": by_name(SCORES),
}


class ModelFileError(FileError):
    """A model file cannot be read; the message is one sentence for the user."""


def save(
    field: TetField,
    path: str | Path,
    metadata_: dict[str, Any] | None = None,
    entry_bits: int | None = None,
) -> None:
    """Write a field; the file appears only when it is complete.

    Entries that nothing reaches are left out and the others rounded, to half precision or
    to one byte with a scale per level and feature; `load` returns what is left.

    Args:
        metadata_: What to say of its training beyond `field.meta`.
        entry_bits: 16 or 8, per feature of an entry; None: as in the file that the field was
            read from, 16 if it was read from none.
    """
    path = Path(path)
    arrays = pack(field, metadata_, entry_bits)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as partial, open(partial, "wb") as stream:
        write(arrays, stream)


def save_exactly(field: TetField, path: Path) -> Path:
    """Write a field with as many bits an entry as keep its table, as it was read from a file."""
    for bits in (8, 16):
        save(field, path, entry_bits=bits)
        if bits == 16 or np.array_equal(load(path).table, field.table):
            return path


def write(arrays: dict, stream):
    """Write arrays as a file that `load` accepts: deflated, unless that makes it too small."""
    np.savez_compressed(stream, **arrays)
    if sum(a.nbytes for a in arrays.values()) > unpacked_limit(stream.tell()):
        stream.seek(0)  # `load` would take it for a bomb
        stream.truncate()
        np.savez(stream, **arrays)


def pack(field: TetField, metadata_: dict | None = None, entry_bits: int | None = None) -> dict:
    """The arrays that `save` writes."""
    entry_bits = entry_bits or field.entry_bits or 16
    arrays, spacing = pack_mesh(field.mesh, field.occupancy)
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    arrays |= pack_tables(field.table, field.layout, reached, entry_bits)
    arrays |= pack_layers("density", field.density_layers)
    arrays |= pack_layers("color", field.color_layers, half=field.options.deferred)
    if field.surroundings:
        arrays |= pack_surroundings(field.surroundings)
    if field.stiffness is not None:
        arrays["stiffness"] = field.stiffness.astype(np.float16)
    arrays |= field.rig_arrays or {}
    training = {key: value for key, value in field.meta.items() if key != WHOLE_OF}
    meta = meta_text(field, spacing, training | (metadata_ or {})).encode()
    if len(meta) > LONGEST_META:
        raise ValueError(f"what is said of the training has {len(meta)} bytes, over {LONGEST_META}")
    return arrays | {"meta": np.frombuffer(meta, np.uint8)}


def load(path: str | Path, content: bytes | None = None) -> TetField:
    """Read and check a model file.

    Args:
        content: All bytes of a model inside the file at `path`, which is not read then.

    Raises:
        ModelFileError: The file is missing, is no model, has another version or is damaged.
    """
    path = Path(path)
    with (
        one_sentence(path, foreseen=FileError, kind=ModelFileError),
        open_archive(path, "model file", content) as arrays,
    ):
        check(
            content is not None or not is_project(path),
            "it is a project, which only `view` and `render` open: give the model itself",
        )
        return _build(arrays)


def bytes_of_file(path: str | Path) -> dict[str, int]:
    """Bytes of a model's mesh (occupancy included) and of its tables, as stored."""
    counts = {"mesh_bytes": 0, "table_bytes": 0}
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            name = entry.filename.removesuffix(".npy")
            if name in MESH_ARRAYS:
                counts["mesh_bytes"] += entry.compress_size
            elif name.startswith(TABLE_ARRAYS):
                counts["table_bytes"] += entry.compress_size
    return counts


def _build(arrays) -> TetField:
    check("meta" in arrays, "it is not a deformrf model: it has no 'meta' array")
    meta_bytes = declared(arrays, "meta", np.uint8, (None,)).shape[0]
    check(meta_bytes <= LONGEST_META, f"its 'meta' has {meta_bytes} bytes, over {LONGEST_META}")
    meta = read_meta(array(arrays, "meta", np.uint8, (None,)).tobytes().decode())
    options = read_options(meta["options"])
    check(
        meta["format_version"] >= RAY_COLOR_VERSION or not options.deferred,
        f"it has one color a ray, which format version {meta['format_version']} does not know",
    )
    entry_counts, dense_count = meta["entry_counts"], meta["dense_level_count"]
    check_levels(entry_counts, dense_count, options)
    check_tables(arrays, entry_counts)
    tet_count = declared(arrays, "tets", INTEGERS, (None, 4)).shape[0]
    check_work(tet_count, entry_counts, dense_count, options)
    world_to_model = np.array(meta["world_to_model"], float)
    check_world(world_to_model)
    # Version 1 has no lattice spacing: it stores every rest vertex.
    mesh, occupancy = unpack_mesh(arrays, meta.get("lattice_spacing"), options.level_count)
    neighbours = tet_neighbours(mesh.tets)
    check_geometry(mesh, neighbours, options.march_step)
    layout = make_layout(mesh, options.level_count, options.table_size, options.dense_levels)
    check(
        list(layout.entry_counts) == entry_counts and layout.dense_level_count == dense_count,
        f"its levels should have {list(layout.entry_counts)} entries, "
        f"{layout.dense_level_count} of them dense; "
        f"it declares {entry_counts}, {dense_count} of them dense",
    )
    table = unpack_tables(arrays, layout)
    surroundings = unpack_surroundings(arrays)
    density, color = (
        unpack_layers(arrays, name, widths, half=name == "color" and options.deferred)
        for name, widths in zip(("density", "color"), layer_widths(options), strict=True)
    )
    _check_networks("", table, density, color)
    if surroundings:
        learned = surroundings.table, surroundings.density_layers, surroundings.color_layers
        _check_networks("surroundings_", *learned)
    return TetField(
        mesh=mesh,
        neighbours=neighbours,
        occupancy=occupancy,
        layout=layout,
        table=table,
        density_layers=density,
        color_layers=color,
        options=options,
        world_to_model=world_to_model,
        meta=read_training(meta.get("training")),
        surroundings=surroundings,
        stiffness=unpack_stiffness(arrays, mesh.vertex_count),
        rig_arrays=unpack_rig(arrays, mesh.vertex_count),
        entry_bits=stored_bits(arrays, options.level_count),
    )


def _check_networks(prefix, table, density, color):
    """Interpolated features are at most as large as the table's; harmonics are below 2."""
    h = check_weights(f"{prefix}density", density, float(np.abs(table).max(initial=0.0)))
    check_weights(f"{prefix}color", color, max(h, 2.0))


def meta_text(field: TetField, lattice_spacing: float | None, training: dict) -> str:
    """The values of a model file's `meta`."""
    version = RAY_COLOR_VERSION if field.options.deferred else SAMPLE_COLOR_VERSION
    return json.dumps(
        {
            "format": FORMAT,
            "format_version": version,
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
        FileError, or ValueError if it is no JSON.
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
        f"this program reads {', '.join(map(str, READABLE_VERSIONS))}",
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
            check(type(value) is option.type, f"its option '{option.name}' is {shown(value)}")
    check(1 <= options.level_count <= 10, f"it has {options.level_count} levels, not 1 to 10")
    check(
        options.table_size <= MOST_ENTRIES,
        f"its tables have {options.table_size} entries, more than {MOST_ENTRIES}",
    )
    check(
        SMALLEST_MARCH_STEP <= options.march_step < 1.0,
        f"its march step is {options.march_step}, below {SMALLEST_MARCH_STEP} or above 1",
    )
    for name, widths in zip(("density", "color"), layer_widths(options), strict=True):
        check_widths(name, widths)
    return options


def read_training(values) -> dict:
    """The facts on a model's training; entries of a wrong type are dropped."""
    if not isinstance(values, dict):
        return {}
    known = {k: v for k, v in values.items() if k not in TRAINING or TRAINING[k](v)}
    for key in SHOWN:
        if key in known:
            known[key] = printable(known[key])[:LONGEST_LINE]
    if "history" in known:
        known["history"] = [row for row in known["history"] if _is_history_row(row)]
    if "test_mean" in known:
        known["test_mean"] = {n: score for n, score in known["test_mean"].items() if FINITE(score)}
    return known


def _is_history_row(row) -> bool:
    numbers = isinstance(row, dict) and all(FINITE(row.get(key)) for key in HISTORY_KEYS)
    return numbers and row["seconds"] > 0 and row["stage"] in (1, 2)
