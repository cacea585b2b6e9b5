"""deformrf rig bind and info: a rig for a model, and what a model's rig holds."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from ..core import field as fields
from ..core.base.arguments import Arg, Model, Output, writable_file
from ..core.base.streams import printable
from ..core.geometry import components
from ..wings import rig as rigs
from .options import OnCpu

Weights = Literal["harmonic", "nearest", "rigid", "automatic"]
Transform = Annotated[tuple[(float,) * 16] | None, Arg("M11 ... M44")]
# Of the space that a rig's surface or the object fills, the share that both fill.  Shapes that
# belong together had 0.68 and more, or 0.53 in a running pose, others 0.53 and less:
# docs/design/010-rigs.md.
LEAST_SHARED, WELL_SHARED = 0.5, 0.6


@dataclass(frozen=True)
class BindArguments(OnCpu):
    """Give a model the bones, weights and clips of a rig."""

    model: Model
    """Model file, an .npz."""
    rig: Annotated[Path, Arg("RIG", positional=True)]
    """A skinned mesh and its clips (.glb, .gltf), a rig.npz of this model, or bones with matrices
    (.json)."""
    output: Output
    """Model file to write, an .npz; it may be MODEL."""
    weights: Weights | None = None
    """Weights of the skinned mesh, smooth inside (harmonic) or of its nearest point (nearest); or
    from the bones, smooth (automatic) or one for each vertex (rigid). Default: harmonic, for a
    .json automatic."""
    transform: Transform = None
    """Matrix [4x4, row by row] from the rig's space (z up) to that of the photographs' cameras;
    without it the rig's surface is laid on the model."""


@dataclass(frozen=True)
class InfoArguments(OnCpu):
    """Print the bones and clips of a model's rig."""

    model: Model
    """Model file with a rig, an .npz."""


def prepare_bind(arguments: BindArguments):
    field = fields.load(arguments.model)
    output = writable_file(arguments.output, ".npz", source=arguments.rig)
    rig, makers = bound(field, arguments)
    known = field.attribution
    every = dict.fromkeys(filter(None, (*known.split("; "), *makers.split("; "))))  # once each
    meta = {"attribution": "; ".join(every)}

    def job():
        fields.save(replace(field, rig_arrays=rigs.arrays_of(rig)), output, meta)
        print(f"Wrote {printable(output)}: {summary(rig)}.")
        return 0

    return job


def prepare_info(arguments: InfoArguments):
    rig = rig_of_model(arguments.model)[1]

    def job():
        print("\n".join(map(printable, description(rig))))
        return 0

    return job


def bound(field, arguments: BindArguments) -> tuple[rigs.Rig, str]:
    """The rig of a file for a TetField, and who made it if the file says so.

    Raises:
        ValueError: The file holds no rig, or none that fits.
    """
    path, mesh = arguments.rig, field.mesh
    if path.suffix == ".npz":
        if arguments.weights or arguments.transform:
            raise ValueError(f"{path} has weights of its own: leave out --weights and --transform")
        return rigs.load_rig(path, mesh.vertex_count), ""
    if path.suffix in (".glb", ".gltf"):
        source = rigs.read_gltf(path)
    elif path.suffix == ".json":
        source = rigs.read_matrices(path)
    else:
        raise ValueError(f"the rig, {path}, has to be a .glb, .gltf, .npz or .json")
    surface = len(source.points) > 0
    kind = arguments.weights or ("harmonic" if surface else "automatic")
    if kind in ("harmonic", "nearest") and not surface:
        raise ValueError(f"{path} has no skinned mesh: take --weights automatic, or rigid")
    matrix, shared = placed(field, source, arguments)
    source = rigs.aligned(source, matrix)
    weights, offsets = weights_of(mesh, source, kind)
    for note in source.notes:
        print(printable(f"{path}: {note}"))
    if shared is not None:
        print(f"The rig and the model share {shared:.0%} of the space that they fill.")
    if shared is not None and shared < WELL_SHARED:
        print(
            "That is little (the same shape has some 70 % or more): if the object is in another "
            "pose than the rig at rest, pose one like the other, or give --transform."
        )
    return rigs.Rig(source.skeleton, weights, source.clips, offsets), source.copyright


def placed(field, source: rigs.GltfRig, arguments: BindArguments):
    """The matrix from the rig's space to model space [4, 4], and how much space they share.

    The latter is None for a rig without a surface.

    Raises:
        ValueError: The rig's surface has another shape than the object, or --transform is none.
    """
    given, matrix = arguments.transform, field.world_to_model
    if given is not None:
        rigs.scale_of(np.reshape(given, (4, 4)), "--transform")
        matrix = matrix @ np.reshape(given, (4, 4))
    if len(source.points) == 0:
        return matrix, None
    edge = 0.02 * float(np.linalg.norm(np.ptp(source.points, axis=0)))
    surface = source.points, source.triangles, source.point_weights[:, :1]
    samples, matter = rigs.surface_samples(*surface, edge)[0], matter_of(field)
    if given is None:
        matrix = rigs.align(samples, matter)
    shared = rigs.shared_space(samples @ matrix[:3, :3].T + matrix[:3, 3], matter)
    if shared < LEAST_SHARED and given is None:
        raise ValueError(
            f"{arguments.rig} is the rig of another object, or of this one in another pose: laid "
            f"on the model, both share {shared:.0%} of the space that they fill, and it has to be "
            f"{LEAST_SHARED:.0%}; pose one like the other, or say where it lies with --transform"
        )
    return matrix, shared


def weights_of(mesh, source: rigs.GltfRig, kind: Weights):
    """Weights of a mesh [V, B] for a rig in its space, and offsets [V, B, 3] or None."""
    if kind == "harmonic":
        return rigs.fitted_weights(mesh, source.points, source.triangles, source.point_weights)
    if kind == "nearest":
        surface = source.points, source.triangles, source.point_weights
        return rigs.nearest_point_weights(mesh, *surface)
    moving = source.point_weights.any(axis=0) if len(source.points) else None
    make = rigs.automatic_weights if kind == "automatic" else rigs.rigid_weights
    return make(mesh, source.skeleton, moving), None


def matter_of(field):
    """Points of the object's surface, without specks.  [N, 3]"""
    middles, occupied = fields.subtet_middles(field.mesh), fields.unpack_mask(field.occupancy)
    labels = components(field.mesh.vertex_count, field.mesh.tets)[field.mesh.tets[:, 0]]
    counts = np.bincount(labels, occupied.sum(axis=1))
    occupied &= (counts >= 0.05 * counts.sum())[labels][:, None]
    places = middles[occupied]
    if not len(places):
        raise ValueError("the model is empty: there is nothing to bind")
    box = np.ptp(field.mesh.rest_vertices[field.mesh.tets], axis=1)
    return rigs.outer_points(places, 0.4 * float(np.median(box)))


def rig_of_model(path: Path):
    """The TetField of a model file, and its rig.

    Raises:
        ValueError: The model has no rig, or a damaged one.
    """
    field = fields.load(path)
    if field.rig_arrays is None:
        raise ValueError(
            f"{path} has no rig: deformrf rig bind {path} RIG.glb -o rigged.npz gives it one"
        )
    try:
        return field, rigs.rig_from(field.rig_arrays, field.mesh.vertex_count)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def summary(rig: rigs.Rig) -> str:
    names = ", ".join(clip.name for clip in rig.clips)
    clips = f"clips {names}" if names else "no clips"
    return printable(f"{rig.skeleton.bone_count} bones, {clips}")


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
