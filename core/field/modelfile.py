"""model.npz <-> TetField.  The format is described field by field in docs/model-format.md.

Reading checks everything before it builds anything: archive.py the file and its arrays,
packing.py mesh and tables, this module what `meta` says.
"""

import json
import os
import tomllib
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

import numpy as np

from ..geometry import tet_neighbours
from ..paths import ROOT
from .archive import ModelFileError, check, read_arrays
from .encoding import FEATURES, make_layout
from .field import FieldOptions, TetField, layer_widths
from .networks import ACTIVATIONS
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

FORMAT = "deformrf-model"
FORMAT_VERSION = 2
READABLE_VERSIONS = (1, 2)
SMALLEST_MARCH_STEP = 1e-4  # a finer one would take a ray through a million pieces


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
    partial = path.with_name(path.name + ".part")
    try:
        with open(partial, "wb") as stream:
            np.savez(stream, **arrays)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def pack(field: TetField, metadata_: dict | None = None, entry_bits=16) -> dict:
    """The arrays that `save` writes."""
    arrays, spacing = pack_mesh(field.mesh, field.occupancy)
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    arrays |= pack_tables(field.table, field.layout, reached, entry_bits)
    arrays |= pack_layers("density", field.density_layers)
    arrays |= pack_layers("color", field.color_layers)
    if field.surroundings:
        arrays |= pack_surroundings(field.surroundings)
    meta = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "program_version": program_version(),
        "options": asdict(field.options),
        "feature_count": FEATURES,
        "dense_level_count": field.layout.dense_level_count,
        "entry_counts": list(field.layout.entry_counts),
        "lattice_spacing": spacing,
        "world_to_model": field.world_to_model.tolist(),
        "training": {**field.meta, **(metadata_ or {})},
    }
    return arrays | {"meta": np.frombuffer(json.dumps(meta).encode(), np.uint8)}


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
        raise ModelFileError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ModelFileError(f"{path} is damaged: {error}") from error


def program_version() -> str:
    """Of this program, installed or in a checkout."""
    try:
        return metadata.version("deformrf")
    except metadata.PackageNotFoundError:
        project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        return tomllib.loads(project)["project"]["version"]


def _build(arrays) -> TetField:
    meta = json.loads(arrays["meta"].tobytes().decode())
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
    values = dict(meta["options"])
    for name in ("density_hidden", "color_hidden"):
        values[name] = tuple(values[name])
    options = FieldOptions(**values)
    check(
        options.density_activation in ACTIVATIONS,
        f"its activation '{options.density_activation}' is unknown",
    )
    check(
        SMALLEST_MARCH_STEP <= options.march_step < 1.0,
        f"its march step is {options.march_step}, below {SMALLEST_MARCH_STEP} or above 1",
    )
    check(
        meta["feature_count"] == FEATURES,
        f"it has {meta['feature_count']} features per entry, this program reads {FEATURES}",
    )

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
    table = unpack_tables(arrays, layout)
    density, color = layer_widths(options)
    world_to_model = np.array(meta["world_to_model"], float)
    check(
        world_to_model.shape == (4, 4) and np.isfinite(world_to_model).all(),
        "its 'world_to_model' is no 4x4 matrix",
    )
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
        meta=meta.get("training", {}),
        surroundings=unpack_surroundings(arrays),
    )
