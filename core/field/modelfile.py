"""model.npz <-> TetField.  The format is described field by field in docs/model-format.md.

A file is checked before anything is built from it: sizes from the zip's own headers
first (a small file must not unpack to gigabytes), then names, types, shapes, index
ranges and finiteness.  Whatever is wrong ends in one sentence, a ModelFileError.
"""

import json
import math
import os
import tomllib
import zipfile
import zlib
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

import numpy as np

from ..geometry.mesh import TetMesh, signed_volumes, tet_neighbours
from ..paths import ROOT
from .encoding import FEATURES, make_layout
from .field import FieldOptions, TetField, layer_widths
from .network import ACTIVATIONS

FORMAT = "deformrf-model"
FORMAT_VERSION = 1
MAX_BYTES = 2**31  # unpacked; a full-size model has about 2^25
SMALLEST_MARCH_STEP = 1e-4  # a finer one would take a ray through a million pieces
# Whatever zipfile and NumPy raise on damaged files; RuntimeError is for encrypted ones.
UNREADABLE = (
    *(zipfile.BadZipFile, zlib.error, EOFError, OSError),
    *(ValueError, KeyError, MemoryError, RuntimeError),
)


class ModelFileError(ValueError):
    """A model file that can't be read, in one sentence for the user."""


def save(field: TetField, path, metadata_: dict | None = None):
    """Write a field; the file appears only when it is complete.

    Tables are stored in half precision, so `load` returns them rounded.
    """
    path = Path(path)
    arrays = {
        "rest_vertices": field.mesh.rest_vertices.astype(np.float64),
        "addresses": field.mesh.addresses.astype(np.int32),
        "tets": field.mesh.tets.astype(np.int32),
        "occupancy": field.occupancy.astype(np.uint64),
    }
    offsets = field.layout.offsets
    for level in range(field.layout.level_count):
        part = field.table[offsets[level] : offsets[level + 1]]
        arrays[f"table_{level}"] = part.astype(np.float16)
    for name, layers in (("density", field.density_layers), ("color", field.color_layers)):
        for i, (weights, bias) in enumerate(layers):
            arrays[f"{name}_weights_{i}"] = weights.astype(np.float32)
            arrays[f"{name}_bias_{i}"] = bias.astype(np.float32)
    meta = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "program_version": program_version(),
        "options": asdict(field.options),
        "feature_count": FEATURES,
        "dense_level_count": field.layout.dense_level_count,
        "entry_counts": list(field.layout.entry_counts),
        "world_to_model": field.world_to_model.tolist(),
        "training": {**field.meta, **(metadata_ or {})},
    }
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".part")
    try:
        with open(partial, "wb") as stream:
            np.savez(stream, **arrays)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def load(path) -> TetField:
    """Read and check a model file.

    Raises:
        ModelFileError: The file is missing, is no model, has another version or is damaged.
    """
    path = Path(path)
    if not path.is_file():
        raise ModelFileError(f"there is no model file at {path}")
    try:
        arrays = _read_arrays(path)
    except ModelFileError:
        raise
    except UNREADABLE as error:
        raise ModelFileError(f"{path} is not a model file, or is damaged ({error})") from error
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


def _read_arrays(path):
    with zipfile.ZipFile(path) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_BYTES:
            raise ModelFileError(
                f"{path} would unpack to {size / 2**30:.1f} GiB; models have less than "
                f"{MAX_BYTES / 2**30:.0f} GiB"
            )
        for entry in archive.infolist():
            _check_header(archive, entry)
    with np.load(path, allow_pickle=False) as archive:
        if "meta" not in archive.files:
            raise ModelFileError(f"{path} is not a deformrf model: it has no 'meta' array")
        return {name: archive[name] for name in archive.files}


def _check_header(archive, entry):
    """An array's own header must not promise more than the zip holds."""
    with archive.open(entry) as stream:
        version = np.lib.format.read_magic(stream)
        read = {(1, 0): np.lib.format.read_array_header_1_0}.get(
            version, np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = read(stream)
    if math.prod(shape) * dtype.itemsize > entry.file_size:
        raise ModelFileError(f"'{entry.filename}' declares {shape}, more than the file holds")


def _check(condition, sentence):
    if not condition:
        raise ModelFileError(sentence)


def _array(arrays, name, dtype, shape):
    """The named array, checked; None in `shape` stands for any length."""
    _check(name in arrays, f"the array '{name}' is missing")
    array = arrays[name]
    fits = array.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, array.shape, strict=True)
    )
    _check(
        array.dtype == dtype and fits,
        f"'{name}' is {array.dtype} {list(array.shape)}, "
        f"it should be {np.dtype(dtype)} {['any' if s is None else s for s in shape]}",
    )
    if array.dtype.kind == "f":
        _check(np.isfinite(array).all(), f"'{name}' holds NaN or infinite values")
    return array


def _build(arrays) -> TetField:
    meta = json.loads(arrays["meta"].tobytes().decode())
    _check(
        isinstance(meta, dict) and meta.get("format") == FORMAT,
        "it is not a deformrf model: its 'meta' names no such format",
    )
    version = meta.get("format_version")
    _check(
        version == FORMAT_VERSION,
        f"it has format version {version}, this program reads version {FORMAT_VERSION}",
    )
    values = dict(meta["options"])
    for name in ("density_hidden", "color_hidden"):
        values[name] = tuple(values[name])
    options = FieldOptions(**values)
    _check(
        options.density_activation in ACTIVATIONS,
        f"its activation '{options.density_activation}' is unknown",
    )
    _check(
        SMALLEST_MARCH_STEP <= options.march_step < 1.0,
        f"its march step is {options.march_step}, below {SMALLEST_MARCH_STEP} or above 1",
    )
    _check(
        meta["feature_count"] == FEATURES,
        f"it has {meta['feature_count']} features per entry, this program reads {FEATURES}",
    )

    rest_vertices = _array(arrays, "rest_vertices", np.float64, (None, 3))
    vertex_count = len(rest_vertices)
    addresses = _array(arrays, "addresses", np.int32, (vertex_count, 3))
    tets = _array(arrays, "tets", np.int32, (None, 4))
    _check(len(tets) > 0, "it has no tets")
    _check(
        tets.min() >= 0 and tets.max() < vertex_count,
        f"'tets' names vertices outside 0..{vertex_count - 1}",
    )
    limit = 2**20 >> (options.level_count - 1)
    _check(addresses.min() >= 0 and addresses.max() < limit, f"'addresses' leave 0..{limit - 1}")
    occupancy = _array(arrays, "occupancy", np.uint64, (len(tets),))
    mesh = TetMesh(rest_vertices, addresses, tets)
    _check((signed_volumes(rest_vertices, tets) > 0).all(), "some tets have no rest volume")

    layout = make_layout(mesh, options.level_count, options.table_size)
    _check(
        list(layout.entry_counts) == meta["entry_counts"]
        and layout.dense_level_count == meta["dense_level_count"],
        f"its levels should have {list(layout.entry_counts)} entries, "
        f"{layout.dense_level_count} of them dense; "
        f"it declares {meta['entry_counts']}, {meta['dense_level_count']} of them dense",
    )
    table = np.concatenate(
        [
            _array(arrays, f"table_{level}", np.float16, (count, FEATURES))
            for level, count in enumerate(layout.entry_counts)
        ]
    ).astype(np.float32)

    def layers(name, widths):
        return tuple(
            (
                _array(arrays, f"{name}_weights_{i}", np.float32, (widths[i], widths[i + 1])),
                _array(arrays, f"{name}_bias_{i}", np.float32, (widths[i + 1],)),
            )
            for i in range(len(widths) - 1)
        )

    density, color = layer_widths(options)
    world_to_model = np.array(meta["world_to_model"], float)
    _check(
        world_to_model.shape == (4, 4) and np.isfinite(world_to_model).all(),
        "its 'world_to_model' is no 4x4 matrix",
    )
    return TetField(
        mesh=mesh,
        neighbours=tet_neighbours(tets),
        occupancy=occupancy,
        layout=layout,
        table=table,
        density_layers=layers("density", density),
        color_layers=layers("color", color),
        options=options,
        world_to_model=world_to_model,
        meta=meta.get("training", {}),
    )
