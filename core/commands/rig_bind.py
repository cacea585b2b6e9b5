"""deformrf-rig info: what a model's rig holds."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from .. import field as fields
from .. import rig as rigs
from ..streams import printable


@dataclass(frozen=True)
class InfoArguments:
    """Print the bones and clips of a model's rig."""

    model: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="MODEL")]
    """Model file with a rig, an .npz."""


def prepare_info(arguments: InfoArguments):
    rig = rig_of_model(arguments.model)[1]

    def job():
        print("\n".join(map(printable, description(rig))))
        return 0

    return job


def rig_of_model(path: Path):
    """The TetField of a model file, and its rig.

    Raises:
        ValueError: The model has no rig, or a damaged one.
    """
    field = fields.load(path)
    if field.rig_arrays is None:
        raise ValueError(
            f"{path} has no rig: deformrf-rig bind {path} RIG.glb -o rigged.npz gives it one"
        )
    try:
        return field, rigs.rig_from(field.rig_arrays, field.mesh.vertex_count)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def description(rig: rigs.Rig) -> list[str]:
    """The bones as a tree with the share of vertices that each moves most, then the clips."""
    skeleton = rig.skeleton
    share = np.bincount(rig.weights.argmax(axis=1), minlength=skeleton.bone_count)
    lines = [f"{skeleton.bone_count} bones for {len(rig.weights)} vertices:"]
    depth = []
    for bone, parent in enumerate(skeleton.parents.tolist()):
        depth.append(1 if parent < 0 else depth[parent] + 1)
        lines.append(f"{'  ' * depth[bone]}{skeleton.names[bone]}: leads {share[bone]} vertices")
    lines.append(f"{len(rig.clips)} clips:" if rig.clips else "no clips")
    for clip in rig.clips:
        what = "all vertices"
        if isinstance(clip, rigs.Clip):
            what = f"{len({channel.bone for channel in clip.channels})} bones"
        lines.append(f"  {clip.name}: {clip.duration:.3g} s, {what}")
    return lines
