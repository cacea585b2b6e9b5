"""deformrf rig export, check and import: a model's mesh to Blender, and what comes back."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from ..core import deform, render
from ..core import field as fields
from ..core.base.archive import open_archive
from ..core.base.arguments import Arg, Model, Output, writable_file
from ..core.base.paths import ASSETS
from ..core.base.streams import printable
from ..core.geometry import boundary_faces, signed_volumes
from ..wings import rig as rigs
from .options import OnCpu
from .running import FAILED, require

ADDON = ASSETS / "blender" / "deformrf_rig.py"
OUTSIDE = 0.01  # of the mesh's size, from a vertex to where its color's ray starts
Back = Annotated[Path, Arg("RIG", positional=True)]
Rate = Annotated[float, Arg("N", name="fps")]


@dataclass(frozen=True)
class ExportArguments(OnCpu):
    """Write a model's mesh for Blender (.ply), ParaView (.vtu) or USD (.usda, .usdc)."""

    model: Model
    """Model file, an .npz."""
    output: Output
    """File to write, a .ply, .vtu, .usda, .usd or .usdc."""


@dataclass(frozen=True)
class CheckArguments(OnCpu):
    """Check what came back from Blender: vertices, order, weights, clips, inverted tets."""

    model: Model
    """Model file whose mesh was exported, an .npz."""
    file: Back
    """The add-on's .npz, or a point cache: .pc2, .mdd or .npz."""
    frames_per_second: Rate = rigs.FRAMES_PER_SECOND
    """Frames per second of a .pc2, which does not say so."""


@dataclass(frozen=True)
class ImportArguments(OnCpu):
    """Give a model the rig that Blender's add-on exported, or the clip of a point cache."""

    model: Model
    """Model file whose mesh was exported, an .npz."""
    file: Back
    """The add-on's .npz, or a point cache: .pc2, .mdd or .npz."""
    output: Output
    """Model file to write, an .npz; it may be MODEL."""
    inside: Literal["harmonic", "file"] = "harmonic"
    """Weights of the vertices inside: smooth between those of the surface, or the file's own."""
    frames_per_second: Rate = rigs.FRAMES_PER_SECOND
    """Frames per second of a .pc2, which does not say so."""


def prepare_export(arguments: ExportArguments):
    field = fields.load(arguments.model)
    ending = arguments.output.suffix.lower()
    if ending not in rigs.MESH_ENDINGS:
        known = ", ".join(rigs.MESH_ENDINGS)
        raise ValueError(f"the file to write, {arguments.output}, has to end in one of {known}")
    if ending == ".vtu":
        require("meshio")
    elif ending != ".ply":
        require("pxr")
    output = writable_file(arguments.output, arguments.output.suffix)

    def job():
        mesh, colors, surface = field.mesh, None, None
        if ending == ".ply":
            renderer = render.Renderer(field)
            colors, surface = vertex_colors(field, renderer), render.preview(field, renderer)
        side = float(np.ptp(mesh.rest_vertices, axis=0).max())
        meters_per_unit = (field.meta.get("size") or side) / side
        rigs.export_mesh(
            mesh, output, colors, surface, deform.Material(), meters_per_unit, field.attribution
        )
        print(f"Wrote {printable(output)}: {mesh.vertex_count} vertices, {mesh.tet_count} tets.")
        if ending == ".ply":
            print(
                "Blender opens it with the add-on (Edit > Preferences > Add-ons > Install from "
                f"Disk): {printable(ADDON)}"
            )
        return 0

    return job


def prepare_check(arguments: CheckArguments):
    mesh = fields.load(arguments.model).mesh
    found = read_back(arguments.file, mesh, arguments.frames_per_second)

    def job():
        lines, inverted = findings(found, mesh)
        print("\n".join(map(printable, lines)))
        return FAILED if inverted else 0

    return job


def prepare_import(arguments: ImportArguments):
    field = fields.load(arguments.model)
    output = writable_file(arguments.output, ".npz", source=arguments.file)
    found = read_back(arguments.file, field.mesh, arguments.frames_per_second)
    if isinstance(found, rigs.VertexClip):
        rig = with_clip(field, found)
    else:
        rig = rigs.rig_of(found, field.mesh, harmonic=arguments.inside == "harmonic")

    def job():
        fields.save(replace(field, rig_arrays=rigs.arrays_of(rig)), output)
        names = ", ".join(clip.name for clip in rig.clips) or "none"
        count = rig.skeleton.bone_count
        print(printable(f"Wrote {output}: {count} bones, clips: {names}."))
        if isinstance(found, rigs.BlenderRig) and found.method != "linear":
            print("Blender preserved volume: dual quaternion skinning shows the same.")
        for clip in rig.clips:
            if found is not clip and isinstance(clip, rigs.VertexClip):
                print(printable(f"{clip.name} is kept as vertices: bones alone don't tell it."))
        return 0

    return job


def read_back(path: Path, mesh, frames_per_second: float):
    """A BlenderRig of the add-on's file, or the VertexClip of a point cache.

    Raises:
        ValueError: The file is damaged, or of another model.
    """
    if path.suffix.lower() == ".npz" and path.is_file():
        with open_archive(path, "file of arrays") as arrays:
            if "meta" in arrays:
                return rigs.read_blender(path, mesh)
    return rigs.read_cache(path, mesh.vertex_count, frames_per_second)


def with_clip(field, clip: rigs.VertexClip) -> rigs.Rig:
    """The model's rig with one more clip; a rig of one bone if it has none."""
    vertices = field.mesh.rest_vertices
    if field.rig_arrays is not None:
        rig = rigs.rig_from(field.rig_arrays, len(vertices))
        others = tuple(one for one in rig.clips if one.name != clip.name)
        return replace(rig, clips=(*others, clip))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = 0.5 * (low + high)
    foot, top = (*middle[:2], low[2]), (*middle[:2], high[2])
    skeleton = rigs.make_skeleton(["Object"], [-1], [foot], [top])
    return rigs.Rig(skeleton, np.ones((len(vertices), 1), np.float32), (clip,))


def findings(found, mesh):
    """Lines about what came back, and how many tets its worst frame turns inside out."""
    if isinstance(found, rigs.VertexClip):
        line, inverted = clip_line(found.name, found.times, found.vertices, mesh)
        return [f"A point cache of the model's {mesh.vertex_count} vertices.", line], inverted
    weighted = found.weights.sum(axis=1) > 0.0
    lines = [
        f"Blender {found.blender}, {found.skeleton.bone_count} bones, {mesh.vertex_count} vertices "
        "in the model's order, at rest where the model has them.",
        f"Weights sum to 1 at {int(weighted.sum())} vertices; {int((~weighted).sum())} have none.",
    ]
    rig, worst = rigs.rig_of(found, mesh), 0
    for clip, ours in zip(found.clips, rig.clips, strict=True):
        frames = ours.vertices if isinstance(ours, rigs.VertexClip) else posed(rig, clip, found)
        line, inverted = clip_line(clip.name, clip.times, frames, mesh)
        lines.append(line)
        if isinstance(ours, rigs.VertexClip):
            lines.append("  Bones alone don't tell it (shape keys, modifiers): kept as vertices.")
        elif clip.vertices is not None:
            error = rigs.skinning_error(found, clip, mesh)
            lines.append(f"  Our {found.method} skinning differs from Blender's by {error:.2g}.")
        worst = max(worst, inverted)
    return lines, worst


def posed(rig, clip, found):
    for matrices in clip.matrices:
        yield rigs.skinned(found.rest_vertices, rig.weights, matrices, found.method)


def clip_line(name, times, frames, mesh):
    """What is worst in a clip, and how many tets its worst frame turns inside out."""
    rest = signed_volumes(mesh.rest_vertices, mesh.tets)
    smallest, inverted, said = np.inf, 0, ""
    for second, vertices in zip(times, frames, strict=True):
        ratios = signed_volumes(np.asarray(vertices, float), mesh.tets) / rest
        tet = int(ratios.argmin())
        inverted = max(inverted, int((ratios <= 0.0).sum()))
        if ratios[tet] < smallest:
            smallest = float(ratios[tet])
            place = np.asarray(vertices, float)[mesh.tets[tet]].mean(axis=0)
            said = f"at {second:.2f} s near {' '.join(f'{x:.2f}' for x in place)}"
    line = f"{name}: {len(times)} frames, {times[-1]:.2f} s; smallest volume ratio {smallest:.2f} "
    return f"{line}{said}; {inverted} inverted tets in the worst frame.", inverted


def vertex_colors(field, renderer):
    """Colors of the mesh's surface as seen from outside, gray inside.  [V, 3] uint8"""
    faces, _ = boundary_faces(field.mesh.tets, field.neighbours)
    ids, corners = np.unique(faces, return_inverse=True)
    points = field.mesh.rest_vertices[ids]
    normals = render.vertex_normals(points, corners.reshape(-1, 3))
    colors = np.full((field.mesh.vertex_count, 3), 128, np.uint8)
    distance = OUTSIDE * float(np.ptp(field.mesh.rest_vertices, axis=0).max())
    colors[ids], _, _ = render.seen_from_outside(renderer, points, normals, distance)
    return colors
