"""The posed object as a triangle mesh for other programs: PLY or OBJ.

It is the surface of the coarse mesh of tets, around the radiance field.  A vertex has the color
that is seen from there along its normal, inwards; gray where nothing is.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ...core.base.paths import whole_file
from ...core.geometry import boundary_faces
from ...core.render import Renderer, seen_from_outside, vertex_normals
from ...wings.rig import ply_file, ply_lists

OUTSIDE = 0.01  # object sizes from a vertex to where its ray starts
ENDINGS = ".ply", ".obj"


@dataclass(frozen=True)
class SurfaceMesh:
    """Triangles, their corners counterclockwise as seen from outside."""

    vertices: np.ndarray  # [N, 3] float32, model units
    faces: np.ndarray  # [F, 3] int32, ids of vertices
    colors: np.ndarray | None = None  # [N, 3] uint8


def surface_of(tets: np.ndarray, neighbours: np.ndarray, positions: ArrayLike) -> SurfaceMesh:
    """The surface of a mesh with its vertices at `positions` [V, 3].

    Args:
        tets, neighbours: Corners of each tet, and the tet across each face or -1.  [T, 4]

    Raises:
        ValueError: Positions are not numbers.
    """
    faces, _ = boundary_faces(tets, neighbours)
    ids, faces = np.unique(faces, return_inverse=True)
    vertices = np.asarray(positions)[ids].astype(np.float32)
    if not np.isfinite(vertices).all():
        raise ValueError("the pose has vertices that are not numbers: reset it (R)")
    return SurfaceMesh(vertices, faces.reshape(-1, 3).astype(np.int32))


def with_colors(surface: SurfaceMesh, renderer: Renderer, size: float) -> SurfaceMesh:
    """The surface with the colors that a Renderer, which has its pose, sees at each vertex.

    Args:
        size: The object's, in model units.
    """
    normals = vertex_normals(surface.vertices, surface.faces)
    colors, _, _ = seen_from_outside(renderer, surface.vertices, normals, OUTSIDE * size)
    return SurfaceMesh(surface.vertices, surface.faces, colors)


def save_surface(surface: SurfaceMesh, path: str | Path, attribution: str = "") -> Path:
    """Write a file by its ending, one of ENDINGS; an older one stays if that fails.

    Args:
        attribution: One line that the file states: who made the object.

    Raises:
        OSError: It can't be written.
        ValueError: The ending is another one.
    """
    path = Path(path)
    contents = {".ply": _ply, ".obj": _obj}.get(path.suffix.lower())
    if contents is None:
        raise ValueError(f"{path} is no mesh: its name has to end in {' or '.join(ENDINGS)}")
    with whole_file(path) as partial:
        partial.write_bytes(contents(surface, attribution))
    return path


def _ply(surface, attribution):
    kinds, columns = [(axis, "<f4") for axis in "xyz"], [*surface.vertices.T]
    if surface.colors is not None:
        kinds += [(name, "u1") for name in ("red", "green", "blue")]
        columns += [*surface.colors.T]
    vertices, names = np.rec.fromarrays(columns, dtype=kinds), {"<f4": "float", "u1": "uchar"}
    lines = [f"element vertex {len(vertices)}"]
    lines += [f"property {names[kind]} {name}" for name, kind in kinds]
    elements = [(lines, vertices), ply_lists("face", surface.faces)]
    return ply_file("deformrf, model units", attribution, elements)


def _obj(surface, attribution):
    """Wavefront OBJ; colors follow the positions, as most programs read them."""
    lines = ["# deformrf, model units", *([f"# {attribution}"] if attribution else [])]
    rows = surface.vertices.tolist()
    if surface.colors is not None:
        shares = np.round(surface.colors / 255.0, 4).tolist()
        rows = [[*at, *color] for at, color in zip(rows, shares, strict=True)]
    lines += ["v " + " ".join(f"{x:.9g}" for x in row) for row in rows]
    lines += ["f {} {} {}".format(*ids) for ids in (surface.faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode("ascii", "backslashreplace")
