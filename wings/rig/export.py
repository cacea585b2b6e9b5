"""The coarse mesh as a file for other programs: PLY, VTU or USD.

    .ply   vertices in our order with their ids and colors, the surface's triangles, all edges;
           then the tets, and a preview of the object, which other programs than our Blender
           add-on pass over
    .vtu   all tets, for ParaView and other programs that read VTK's files (package meshio)
    .usda, .usd, .usdc   a TetMesh with the deformable body schema of the Alliance for OpenUSD,
           which Newton reads as a soft body (package usd-core)

Positions are those at rest, in model space, z up.  docs/rigs.md has the PLY's elements.

Shapes: V vertices, T tets.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...core.base.paths import whole_file
from ...core.geometry import EmbeddedSurface, TetMesh, boundary_faces, edges, tet_neighbours

if TYPE_CHECKING:
    from ...core.deform import Material

MESH_ENDINGS = ".ply", ".vtu", ".usda", ".usd", ".usdc"
PlyElement = tuple[list[str], np.ndarray]  # lines of the header, and an array of its rows
AXES = "x", "y", "z"
COLORS = "red", "green", "blue"
# Of the deformable body proposal that Newton's importer reads; usd-core has no classes for them.
BODY_SCHEMAS = ("PhysicsDeformableBodyAPI", "PhysicsVolumeDeformableSimAPI", "PhysicsCollisionAPI")
MATERIAL_SCHEMA = "PhysicsVolumeDeformableMaterialAPI"


def export_mesh(
    mesh: TetMesh,
    path: str | Path,
    colors: np.ndarray | None = None,
    preview: EmbeddedSurface | None = None,
    material: "Material | None" = None,
    meters_per_unit: float = 1.0,
    attribution: str = "",
) -> Path:
    """Write a mesh by the file's ending, one of MESH_ENDINGS; an older file stays if that fails.

    Args:
        colors: Of the vertices, for .ply.  [V, 3] uint8
        preview: For .ply.
        material: For USD.
        meters_per_unit: For USD: the length of one unit of the mesh.
        attribution: One line that the file states: who made the object.

    Raises:
        ValueError: The ending is another one.
        ModuleNotFoundError: The package that writes such files is not installed.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in MESH_ENDINGS:
        raise ValueError(f"{path}: the mesh's file has to end in {', '.join(MESH_ENDINGS)}")
    with whole_file(path) as partial:
        if ending == ".ply":
            partial.write_bytes(ply_bytes(mesh, colors, preview, attribution))
        elif ending == ".vtu":
            _write_vtu(mesh, partial, attribution)
        else:
            _write_usd(mesh, partial, material, meters_per_unit, attribution)
    return path


def ply_bytes(
    mesh: TetMesh, colors=None, preview: EmbeddedSurface | None = None, attribution: str = ""
) -> bytes:
    """The mesh as binary PLY."""
    faces, _ = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
    elements = [_vertices(mesh, colors), ply_lists("face", faces), _edges(edges(mesh.tets))]
    elements += [ply_lists("tet", mesh.tets)]
    if preview is not None:
        elements += [_preview(mesh, preview), ply_lists("preview_face", preview.faces)]
    return ply_file("deformrf coarse mesh, model space, z up", attribution, elements)


def ply_file(comment: str, attribution: str, elements: Sequence[PlyElement]) -> bytes:
    """Binary PLY, little endian."""
    header = ["ply", "format binary_little_endian 1.0", f"comment {comment}"]
    header += [f"comment {attribution}"] if attribution else []
    header += [line for lines, _ in elements for line in lines] + ["end_header", ""]
    text = "\n".join(header).encode("ascii", "backslashreplace")
    return text + b"".join(rows.tobytes() for _, rows in elements)


def _vertices(mesh, colors):
    kinds = [("position", "<f4", 3), ("id", "<i4")]
    lines = [f"element vertex {mesh.vertex_count}"]
    lines += [*(f"property float {axis}" for axis in AXES), "property int vertex_id"]
    if colors is not None:
        kinds += [("color", "u1", 3)]
        lines += [f"property uchar {name}" for name in COLORS]
    rows = np.empty(mesh.vertex_count, kinds)
    rows["position"], rows["id"] = mesh.rest_vertices, np.arange(mesh.vertex_count)
    if colors is not None:
        rows["color"] = colors
    return lines, rows


def ply_lists(name: str, ids: np.ndarray) -> PlyElement:
    """An element of `ply_file`: faces or tets [n, corners] int, all with as many corners."""
    width = ids.shape[1]
    rows = np.empty(len(ids), [("count", "u1"), ("ids", "<i4", width)])
    rows["count"], rows["ids"] = width, ids
    return [f"element {name} {len(ids)}", "property list uchar int vertex_indices"], rows


def _edges(ids):
    lines = [f"element edge {len(ids)}", "property int vertex1", "property int vertex2"]
    return lines, ids.astype("<i4")


def _preview(mesh, preview):
    """Each point as color, corners and weights; its place at rest for other programs."""
    kinds = [("position", "<f4", 3), ("color", "u1", 3), ("corners", "<i4", 4)]
    rows = np.empty(len(preview.corners), [*kinds, ("weights", "<f4", 4)])
    rows["position"] = preview.points(mesh.rest_vertices)
    rows["color"], rows["corners"] = preview.colors, preview.corners
    rows["weights"] = preview.weights
    lines = [f"element preview_vertex {len(rows)}"]
    lines += [f"property float {axis}" for axis in AXES]
    lines += [f"property uchar {name}" for name in COLORS]
    lines += [f"property int corner{i}" for i in range(4)]
    return lines + [f"property float weight{i}" for i in range(4)], rows


def _write_vtu(mesh, path, attribution):
    import meshio

    ids = np.arange(mesh.vertex_count, dtype=np.int32)
    points = mesh.rest_vertices.astype(np.float64)
    grid = meshio.Mesh(points, [("tetra", mesh.tets)], point_data={"vertex_id": ids})
    meshio.write(path, grid, file_format="vtu")
    if attribution:
        first, _, rest = path.read_bytes().partition(b"\n")  # <?xml version="1.0"?>
        words = re.sub("-(?=-)", "- ", attribution).encode("ascii", "xmlcharrefreplace")
        path.write_bytes(b"%b\n<!-- %b -->\n%b" % (first, words, rest))


def _write_usd(mesh, path, material, meters_per_unit, attribution):
    from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, meters_per_unit)
    stage.GetRootLayer().comment = attribution
    root = UsdGeom.Xform.Define(stage, "/Object")
    stage.SetDefaultPrim(root.GetPrim())
    body = UsdGeom.TetMesh.Define(stage, "/Object/Tets")
    points = mesh.rest_vertices.astype(np.float32)
    faces, _ = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
    body.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points)))
    body.CreateTetVertexIndicesAttr(Vt.Vec4iArray.FromNumpy(np.ascontiguousarray(mesh.tets)))
    body.CreateSurfaceFaceVertexIndicesAttr(Vt.Vec3iArray.FromNumpy(np.ascontiguousarray(faces)))
    body.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(0), points.max(0)])))
    if material is not None:
        prim = body.GetPrim()
        for name in BODY_SCHEMAS:
            prim.AddAppliedSchema(name)
        solid = UsdShade.Material.Define(stage, "/Object/Solid")
        solid.GetPrim().AddAppliedSchema(MATERIAL_SCHEMA)
        values = {
            "youngsModulus": material.young_modulus,
            "poissonsRatio": material.poisson_ratio,
            "density": material.density,
        }
        for name, value in values.items():
            kind = Sdf.ValueTypeNames.Float
            solid.GetPrim().CreateAttribute(f"physics:{name}", kind).Set(value)
        UsdShade.MaterialBindingAPI.Apply(prim).Bind(solid, materialPurpose="physics")
    stage.GetRootLayer().Save()
