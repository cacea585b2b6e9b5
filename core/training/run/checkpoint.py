"""An unfinished run on disk, which `deformrf train --resume` continues.

It is written beside the model every minute and at Ctrl-C, and removed when the model is complete.
Other programs can't read it, and later versions may not: to keep a result, keep the model file.
"""

import pickle
import struct
import zipfile
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from ...base.paths import whole_file
from ...base.reading import open_file
from ...base.streams import one_line
from ...geometry import TetMesh
from ..train_options import TrainOptions
from .checkpoint_checks import (
    check_archive,
    check_content,
    checked_matrix,
    checked_mesh,
    checked_options,
    checked_report,
)

FORMAT = "deformrf-checkpoint-1"
GONE = {"density_layers": 1, "density_activation": "relu"}  # of older checkpoints
# Options that older checkpoints lack, and what they trained with.
ADDED = {"color_width": 64, "color_depth": 2}
ADDED |= dict.fromkeys(("table_decay", "strong_decay", "depth_cost"), 0.0)
UNREADABLE = (  # what zipfile, pickle and torch raise for bytes that nobody has written so
    *(OSError, EOFError, RuntimeError, ValueError, TypeError, KeyError, IndexError, MemoryError),
    *(AttributeError, AssertionError, OverflowError, ImportError),
    *(pickle.UnpicklingError, zipfile.BadZipFile, zlib.error, struct.error),
)


class CheckpointError(ValueError):
    """A checkpoint that can't be gone on from, in one sentence for the user."""


@dataclass(frozen=True)
class Checkpoint:
    """The state of a run."""

    options: TrainOptions
    stage: int  # 1 or 2
    mesh: TetMesh  # of the stage
    fit: dict  # `Optimization.state()`: steps done, weights, optimizer, occupancy
    world_to_model: np.ndarray  # [4, 4]
    report: dict  # figures of the run so far


def save_checkpoint(checkpoint: Checkpoint, path):
    """Write it; the file appears only when it is complete.

    Raises:
        OSError: It can't be written, in a sentence.
    """
    path, mesh = Path(path), checkpoint.mesh
    content = {
        "format": FORMAT,
        "options": asdict(checkpoint.options),
        "stage": checkpoint.stage,
        "mesh": [torch.from_numpy(a) for a in (mesh.rest_vertices, mesh.addresses, mesh.tets)],
        "fit": checkpoint.fit,
        "world_to_model": checkpoint.world_to_model.tolist(),
        "report": checkpoint.report,
    }
    try:
        with whole_file(path) as partial:
            torch.save(content, partial)
    except (OSError, RuntimeError) as error:  # torch has RuntimeErrors of its own for a full disk
        reason = getattr(error, "strerror", None) or one_line(error)
        raise OSError(f"{path} can't be written ({reason})") from error


def is_checkpoint(path: str | Path) -> bool:
    """Whether a file is a checkpoint of some version, whole or not, or empty."""
    with open_file(path) as stream:
        start = stream.read(2**20)  # torch writes what is no array first
    return not start or (start[:2] == b"PK" and FORMAT.rpartition("-")[0].encode() in start)


def load_checkpoint(path: str | Path) -> Checkpoint:
    """Read a checkpoint; its tensors come to the CPU.

    Raises:
        CheckpointError: There is none, or it is damaged or of another version.
    """
    path = Path(path)
    if not path.is_file():
        raise CheckpointError(
            f"there is no {path} to resume from: it is written every minute and when a run is "
            f"interrupted, and removed when the model is complete"
        )
    try:
        check_archive(path)
        content = torch.load(path, map_location="cpu", weights_only=True)
        check_content(content, path.stat().st_size)
    except UNREADABLE as error:
        raise CheckpointError(f"{path} can't be read as a checkpoint: {one_line(error)}") from None
    try:
        if content["format"] != FORMAT:
            raise CheckpointError(f"{path} is a checkpoint of another version")
        options = dict(content["options"])
        for name, only in GONE.items():
            if options.pop(name, only) != only:
                raise CheckpointError(
                    f"{path} has another {name} than {only!r}, which this version can't train: "
                    f"train it anew"
                )
        if "color_width" not in options:  # then each sample had a color
            options["leave_out"] = (*options["leave_out"], "ray-color")
        if options["aabb"] is not None:
            options["aabb"] = tuple(options["aabb"])
        if content["stage"] not in (1, 2):
            raise KeyError
        options = checked_options(ADDED | options)
        return Checkpoint(
            options,
            content["stage"],
            checked_mesh(content["mesh"], options),
            content["fit"],
            checked_matrix(content["world_to_model"]),
            checked_report(content["report"]),
        )
    except CheckpointError:
        raise
    except UNREADABLE as error:
        raise CheckpointError(
            f"{path} is no checkpoint of this version: {one_line(error)}"
        ) from None
