"""Omissions in a model file, measured by writing the omitted arrays.

Sizes are in 10⁶ bytes, with as many bits per entry as the given file.  A file of an older
format version contains these arrays; its rows then give the saving of writing the model again.
"""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from ....core.field import modelfile
from ....core.field.archive import open_arrays
from ....core.field.packing import pack_tables
from ....core.field.reach import reached_entries
from ....core.geometry import lattice_spacing, lattice_vertices
from ..stopwatch import in_turns
from .frames import Frames
from .measure import FILE, Omission, not_measured, omission, pose_change

FIRST_VERSION = 2  # the first format version with omissions
OLDER = "This file is of an older format that stores it; writing the model again leaves it out."


def file_rows(frames: Frames, path) -> list[Omission]:
    """The rows of a model file, whose field is that of the frames."""
    field = frames.field
    with open_arrays(Path(path)) as stored:
        bits = 8 * stored["table_0"].dtype.itemsize
        meta = json.loads(np.asarray(stored["meta"]).tobytes())
    left_out = meta["format_version"] >= FIRST_VERSION
    arrays = modelfile.pack(field, entry_bits=bits)
    rows = [_entries(frames, arrays, bits, left_out), _rest_vertices(field, arrays, left_out)]
    return [*rows, _surroundings(frames, arrays)] if field.surroundings else rows


def _row(name, with_it, without, change, why, left_out) -> Omission:
    """A row from the arrays of two files; one turn, because a file's size does not vary."""
    turn = in_turns(*([_megabytes(arrays)] for arrays in (with_it, without)))
    return omission(name, FILE, turn, change, why, left_out)


def _entries(frames, arrays, bits, left_out) -> Omission:
    """The row of table entries that no occupied sub-tet reaches."""
    field = frames.field
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    others = {k: a for k, a in arrays.items() if not k.startswith(("reached_", "table_", "scale_"))}
    every = others | pack_tables(field.table, field.layout, np.ones_like(reached), bits)
    # The file does not contain these entries, so noise stands for their values.
    noise = np.random.default_rng(0).normal(size=field.table.shape) * field.table.std()
    noisy, empty = (
        replace(field, table=np.where(reached[:, None], field.table, rest).astype(np.float32))
        for rest in (noise, 0.0)
    )
    change = frames.change(frames.way(noisy), frames.way(empty))
    why = (
        f"{100.0 * (1.0 - reached.mean()):.0f} % of the entries are read by nothing that has"
        " density. A level for which saying so would take more bytes than it saves is stored whole."
    )
    name = "table entries that no occupied sub-tet reaches"
    return _row(name, every, arrays, change, why if left_out else OLDER, left_out)


def _rest_vertices(field, arrays, left_out) -> Omission:
    """The row of positions that follow from the lattice's addresses."""
    name, rest = "rest vertices of a lattice", field.mesh.rest_vertices
    spacing = lattice_spacing(field.mesh)
    if spacing is None:
        why = "The mesh is no lattice: its vertices follow from nothing else, and are stored."
        return not_measured(name, FILE, why, left_out=False)
    derived = lattice_vertices(field.mesh.addresses, spacing)
    change = pose_change(rest, derived, float(np.ptp(rest)))
    why = "They are integer addresses times a spacing." if left_out else OLDER
    return _row(name, arrays | {"rest_vertices": rest}, arrays, change, why, left_out)


def _surroundings(frames, arrays) -> Omission:
    """The row of the surroundings, which are kept."""
    others = {k: a for k, a in arrays.items() if not k.startswith("surroundings_")}
    alone = frames.way(replace(frames.field, surroundings=None))
    change = frames.change(frames.usual, alone)
    why = (
        "They were asked for when the model was trained. Only deformrf-eval reads them, to compare"
        f" whole photographs; in an image of the object their absence changes: {change}."
    )
    return _row("surroundings", arrays, others, change, why, left_out=False)


def _megabytes(arrays) -> float:
    """Size of a file with these arrays [10⁶ bytes]."""
    stream = io.BytesIO()
    modelfile.write(arrays, stream)
    return stream.tell() / 1e6
