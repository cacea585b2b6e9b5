"""The `meta` entry of a model file: JSON text <-> checked values.

docs/model-format.md describes each key.  Keys that fix the field's shape have to be right.
The entry `training` only says where a model comes from: the reader keeps what has the
documented type there and drops the rest, as any key may be missing.
"""

import json
import math
from dataclasses import asdict, fields

import numpy as np

from ..paths import program_version
from .archive import check
from .field import FieldOptions, TetField
from .layout import FEATURES

FORMAT = "deformrf-model"
FORMAT_VERSION = 2
READABLE_VERSIONS = (1, 2)
ACTIVATION = "relu"  # older programs could train density networks with "sigmoid" as well
SMALLEST_MARCH_STEP = 1e-4  # a finer one would take a ray through a million pieces
LARGEST_TABLE = 2**27
HISTORY_KEYS = ("seconds", "stage", "step", "psnr")


def meta_text(field: TetField, lattice_spacing: float | None, training: dict) -> str:
    """What a file says of a field."""
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
        ModelFileError: It is not that of a model, or of another version.
        ValueError: It is no JSON.
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
        options.table_size <= LARGEST_TABLE,
        f"its tables have {options.table_size} entries, more than {LARGEST_TABLE}",
    )
    check(
        SMALLEST_MARCH_STEP <= options.march_step < 1.0,
        f"its march step is {options.march_step}, below {SMALLEST_MARCH_STEP} or above 1",
    )
    return options


def read_transform(values):
    """The `world_to_model` matrix, checked.  [4, 4]"""
    matrix = np.array(values, float)
    check(
        matrix.shape == (4, 4) and np.isfinite(matrix).all(),
        "its 'world_to_model' is no 4x4 matrix",
    )
    return matrix


def read_training(values) -> dict:
    """What is known of a model's training: entries that have another type are dropped."""
    if not isinstance(values, dict):
        return {}
    known = {
        key: value
        for key, value in values.items()
        if key not in TRAINING_TYPES or TRAINING_TYPES[key](value)
    }
    if "history" in known:
        known["history"] = [row for row in known["history"] if _is_history_row(row)]
    if "test_mean" in known:
        known["test_mean"] = {k: v for k, v in known["test_mean"].items() if _is_number(v)}
    return known


def _is_number(value) -> bool:
    """Whether a JSON value is a finite number that fits into 64 bits."""
    if type(value) is float:
        return math.isfinite(value)
    return type(value) is int and abs(value) < 2**63


def _is_time(value) -> bool:
    return _is_number(value) and value > 0


def _is_count(value) -> bool:
    return type(value) is int and 0 <= value < 2**63


def _is_text(value) -> bool:
    return isinstance(value, str)


def _is_history_row(row) -> bool:
    numbers = isinstance(row, dict) and all(_is_number(row.get(key)) for key in HISTORY_KEYS)
    return numbers and row["seconds"] > 0 and row["stage"] in (1, 2)


def _all(kind):
    return lambda values: isinstance(values, list) and all(map(kind, values))


TRAINING_TYPES = {
    "data": _is_text,
    "device": _is_text,
    "diverged": _is_text,
    "seconds": _is_time,
    "stage_1_seconds": _is_time,
    "workers": _is_count,
    "view_count": _is_count,
    "test_view_count": _is_count,
    "options": lambda value: isinstance(value, dict),
    "history": lambda value: isinstance(value, list),
    "test_mean": lambda value: isinstance(value, dict),
    "peak_memory_bytes": _all(_is_number),
    "levels_below_pixel": _all(_is_count),
}
