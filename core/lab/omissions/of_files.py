"""What a model file leaves out, measured by writing it.

Sizes are those of files in a temporary folder, in 10⁶ bytes, with as many bits an entry as
the given file has.  A file that was written before a rule (its format version says so) does
not follow it: the row then says what writing it again would save.

Shapes: V vertices.
"""

import json
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...field import modelfile, pack_tables, reached_entries, read_arrays
from ...geometry import lattice_spacing, lattice_vertices
from .of_rendering import Frames
from .rows import FILE, Omission, compared_once, image_change, not_measured, omission, pose_change

FIRST_VERSION = 2  # of the format that leaves anything out
OLDER = "This file is of an older format that stores it; writing the model again leaves it out."


def file_rows(frames: Frames, path) -> Iterator[Omission]:
    """The rows of a model file, whose field is that of the frames."""
    field, stored = frames.field, read_arrays(Path(path))
    bits = 8 * stored["table_0"].dtype.itemsize
    left_out = json.loads(stored["meta"].tobytes())["format_version"] >= FIRST_VERSION
    arrays = modelfile.pack(field, entry_bits=bits)
    size = _megabytes(arrays)
    yield _entries(frames, arrays, size, bits, left_out)
    yield _rest_vertices(field, arrays, size, left_out)
    if field.surroundings:
        yield _surroundings(frames, arrays, size)


def _entries(frames, arrays, size, bits, left_out) -> Omission:
    """Table entries that no occupied sub-tet reaches."""
    field = frames.field
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    others = {k: a for k, a in arrays.items() if not k.startswith(("reached_", "table_", "scale_"))}
    every = others | pack_tables(field.table, field.layout, np.ones_like(reached), bits)
    # A file has lost what stood in those entries: anything may have, so noise does.
    noise = np.random.default_rng(0).normal(size=field.table.shape) * field.table.std()
    noisy, empty = (
        replace(field, table=np.where(reached[:, None], field.table, rest).astype(np.float32))
        for rest in (noise, 0.0)
    )
    change = image_change(*(frames.images(frames.way(f)) for f in (noisy, empty)))
    share = 100.0 * (1.0 - reached.mean())
    return omission(
        "table entries that no occupied sub-tet reaches",
        FILE,
        compared_once(_megabytes(every), size),
        change,
        f"{share:.0f} % of the entries are read by nothing that has density, whatever stands there."
        if left_out
        else OLDER,
        f"{share:.0f} % of the entries are reached by nothing, fewer than bits that say which would"
        " take: then all are stored. It is decided by level, so it costs nothing where it fails.",
        left_out=left_out,
        unit="MB",
    )


def _rest_vertices(field, arrays, size, left_out) -> Omission:
    """Positions that follow from the lattice's addresses.  [V, 3] float64"""
    name, spacing = "rest vertices of a lattice", lattice_spacing(field.mesh)
    if spacing is None:
        return not_measured(
            name,
            FILE,
            "The mesh is no lattice: its vertices follow from nothing else, and are stored.",
            left_out=False,
            unit="MB",
        )
    rest = field.mesh.rest_vertices
    return omission(
        name,
        FILE,
        compared_once(_megabytes(arrays | {"rest_vertices": rest}), size),
        pose_change(rest, lattice_vertices(field.mesh.addresses, spacing), float(np.ptp(rest))),
        "They are integer addresses times a spacing." if left_out else OLDER,
        "There are too few for the file to shrink.",
        left_out=left_out,
        unit="MB",
    )


def _surroundings(frames, arrays, size) -> Omission:
    """What lies around the object."""
    field = frames.field
    others = {k: a for k, a in arrays.items() if not k.startswith("surroundings_")}
    alone = frames.way(replace(field, surroundings=None))
    change = image_change(frames.images(frames.usual), frames.images(alone))
    reason = (
        "They were asked for when the model was trained. Only deformrf-eval reads them, to"
        f" compare whole photographs; in an image of the object their absence changes: {change}."
    )
    return omission(
        "surroundings",
        FILE,
        compared_once(size, _megabytes(others)),
        change,
        reason,
        reason,
        left_out=False,
        unit="MB",
    )


def _megabytes(arrays) -> float:
    """Of the file that holds these arrays."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.npz"
        np.savez(path, **arrays)
        return path.stat().st_size / 1e6
