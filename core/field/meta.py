"""The `meta` entry of a model file: JSON text <-> checked values.

docs/model-format.md describes each key.  Keys that fix the field's shape have to be right.
The entry `training` only says where a model comes from: the reader keeps what has the
documented type there and drops the rest, as any key may be missing.
"""

import json
from dataclasses import asdict, fields

from ..paths import program_version
from .archive import check
from .field import FieldOptions, TetField
from .layout import FEATURES, MOST_ENTRIES

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
