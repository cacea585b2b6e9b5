"""deformrf edit: a model without some of its tets, as a smaller model."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..core import field as fields
from ..core.base.arguments import Box, Model, Output, Point, Share, writable_file
from ..core.base.device import start_warp
from .options import OnCpu, parsed
from .running import require, run

PROGRAM = "deformrf edit"


@dataclass(frozen=True)
class EditArguments(OnCpu):
    """Take parts of a model away: what lies outside a box or inside one, what is around a thing,
    and specks."""

    model: Model
    """Model file, an .npz."""
    output: Output
    """Model file to write, an .npz; it may be MODEL."""
    keep_box: Box = None
    """Keep what lies in this box, lowest and highest corner [model units]. Without a box, the
    command prints where the model's matter lies."""
    drop_box: Box = None
    """Take away what lies in this box [model units]."""
    keep_at: Point = None
    """Keep the thing at this point [model units], and take away what surrounds it: floors and walls
    that go on beyond it, what lies on them, what reaches the border of the box."""
    specks: Share = 0.01
    """Take away parts with less than this share of the matter, 0 to 1; 0 keeps all."""
    entry_bits: Literal[8, 16] | None = None
    """Bits of each number in the model's tables; by default as many as MODEL has."""


def main() -> int:
    arguments = parsed(PROGRAM, EditArguments)
    return run(PROGRAM, lambda: prepare(arguments))


def prepare(arguments: EditArguments):
    """Check the arguments and read the model; returns the work."""
    start_warp()
    if not 0.0 <= arguments.specks < 1.0:
        raise ValueError(f"--specks is {arguments.specks:g}: give a share, from 0 to less than 1")
    keep, drop = (checked_box(name, arguments) for name in ("keep_box", "drop_box"))
    field = fields.load(arguments.model)
    output = writable_file(arguments.output, ".npz")
    edited = field
    if keep is not None:
        edited = fields.cut(edited, keep)
    if drop is not None:
        edited = fields.cut(edited, drop, keep_inside=False)
    left_out = None
    if arguments.keep_at is not None:
        edited, left_out = alone_at(edited, np.array(arguments.keep_at))
    edited = fields.without_specks(edited, arguments.specks)

    def job():
        if left_out:
            print(left_out)
        fields.save(edited, output, entry_bits=arguments.entry_bits)
        print(
            f"Wrote {output}: {edited.mesh.tet_count} of {field.mesh.tet_count} tets, "
            f"{output.stat().st_size / 1e6:.1f} MB; its matter lies in {bounds(edited)}."
        )
        return 0

    return job


def alone_at(field, point: np.ndarray):
    """The field of the thing at a point [3], and what was left out, in one line."""
    require("scipy")
    if not np.isfinite(point).all():
        raise ValueError(f"--keep-at has to be three numbers; it is {point.tolist()}")
    isolation = fields.isolation_of(field)
    try:
        result = fields.isolated(isolation, [fields.Stroke(point[None], this=True)])
    except ValueError as error:
        raise ValueError(f"--keep-at: {error}") from error
    said = fields.left_out_in_words(isolation, result)
    return fields.kept_field(field, isolation, result), f"Left out {said}."


def checked_box(name: str, arguments: EditArguments):
    """The box of that name [2, 3], None without one; ValueError if it is none."""
    values = getattr(arguments, name)
    if values is None:
        return None
    box = np.reshape(values, (2, 3))
    if not np.isfinite(box).all() or (box[0] >= box[1]).any():
        raise ValueError(
            f"--{name.replace('_', '-')} has to be x0 y0 z0 x1 y1 z1 with each of the first three "
            f"smaller than its counterpart; it is {' '.join(f'{v:g}' for v in values)}"
        )
    return box


def bounds(field) -> str:
    """The box of the model's matter, as --keep-box takes it."""
    places = fields.subtet_middles(field.mesh)[fields.unpack_mask(field.occupancy)]
    if not len(places):
        return "no box: all is empty"
    return " ".join(f"{v:.3g}" for v in (*places.min(axis=0), *places.max(axis=0)))
