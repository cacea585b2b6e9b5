"""The coarse mesh for other programs, read again by parsers of others or of the tests' own."""

import numpy as np
import pytest

from deformrf.core.deform import Material
from deformrf.core.geometry import (
    EmbeddedSurface,
    a15_grid,
    boundary_faces,
    edges,
    signed_volumes,
    tet_neighbours,
)
from deformrf.wings.rig import export_mesh


@pytest.fixture(scope="module")
def mesh():
    return a15_grid(0.25)


TYPES = {"float": "<f4", "int": "<i4", "uchar": "u1"}


def read_ply(path):
    """The elements of a binary PLY whose lists are all of one length: {name: {property: values}}"""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    widths = {"face": 3, "tet": 4, "preview_face": 3}
    elements, at = {}, 0
    for i, line in enumerate(lines):
        if not line.startswith("element "):
            continue
        _, name, count = line.split()
        kinds = []
        for prop in lines[i + 1 :]:
            words = prop.split()
            if words[0] != "property":
                break
            if words[1] == "list":
                kinds += [("count", TYPES[words[2]]), (words[4], TYPES[words[3]], widths[name])]
            else:
                kinds += [(words[2], TYPES[words[1]])]
        rows = np.frombuffer(body, kinds, int(count), at)
        at += rows.nbytes
        elements[name] = rows
    assert at == len(body)
    return elements


def test_a_ply_has_vertices_in_our_order_faces_edges_and_tets(mesh, tmp_path):
    colors = np.random.default_rng().integers(0, 256, (mesh.vertex_count, 3), np.uint8)
    elements = read_ply(export_mesh(mesh, tmp_path / "mesh.ply", colors))
    vertices = elements["vertex"]
    np.testing.assert_array_equal(vertices["vertex_id"], np.arange(mesh.vertex_count))
    for axis, values in zip("xyz", mesh.rest_vertices.T, strict=True):
        np.testing.assert_array_equal(vertices[axis], values.astype(np.float32))
    for channel, values in zip(("red", "green", "blue"), colors.T, strict=True):
        np.testing.assert_array_equal(vertices[channel], values)
    faces, _ = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
    np.testing.assert_array_equal(elements["face"]["vertex_indices"], faces)
    np.testing.assert_array_equal(elements["tet"]["vertex_indices"], mesh.tets)
    pairs = np.column_stack([elements["edge"]["vertex1"], elements["edge"]["vertex2"]])
    np.testing.assert_array_equal(pairs, edges(mesh.tets))


def test_a_ply_carries_the_preview(mesh, tmp_path):
    random = np.random.default_rng()
    surface = EmbeddedSurface(
        mesh.tets[:5],
        random.dirichlet(np.ones(4), 5).astype(np.float32),
        np.array([[0, 1, 2], [2, 3, 4]], np.int32),
        random.integers(0, 256, (5, 3), np.uint8),
    )
    elements = read_ply(export_mesh(mesh, tmp_path / "mesh.ply", preview=surface))
    rows = elements["preview_vertex"]
    for i in range(4):
        np.testing.assert_array_equal(rows[f"corner{i}"], surface.corners[:, i])
        np.testing.assert_array_equal(rows[f"weight{i}"], surface.weights[:, i])
    np.testing.assert_array_equal(rows["green"], surface.colors[:, 1])
    expected = surface.points(mesh.rest_vertices)
    np.testing.assert_allclose(rows["z"], expected[:, 2], atol=1e-6)
    np.testing.assert_array_equal(elements["preview_face"]["vertex_indices"], surface.faces)


@pytest.mark.parametrize("makers", ["", "Mesh by A --- and Öya <x>, CC BY 4.0-"])
@pytest.mark.parametrize("ending", [".ply", ".vtu", ".usda", ".usdc"])
def test_a_file_states_who_made_the_object(mesh, tmp_path, ending, makers):
    if ending == ".vtu":
        meshio = pytest.importorskip("meshio", reason="needs the extra exchange")
    elif ending != ".ply":
        pytest.importorskip("pxr", reason="needs the extra exchange")
    path = export_mesh(mesh, tmp_path / f"mesh{ending}", attribution=makers)
    if ending == ".ply":
        header = path.read_bytes().partition(b"end_header\n")[0].decode("ascii")
        comments = [line[8:] for line in header.splitlines() if line.startswith("comment ")]
        assert comments[1:] == ([makers.replace("Ö", "\\xd6")] if makers else [])
        assert len(read_ply(path)["tet"]) == mesh.tet_count
    elif ending == ".vtu":
        assert len(meshio.read(path).cells_dict["tetra"]) == mesh.tet_count
        comment = makers.replace("---", "- - -").replace("Ö", "&#214;")
        assert path.read_bytes().count(f"<!-- {comment} -->".encode()) == bool(makers)
    else:
        from pxr import Sdf

        assert Sdf.Layer.FindOrOpen(str(path)).comment == makers


def test_another_ending_is_refused(mesh, tmp_path):
    with pytest.raises(ValueError, match=r"has to end in \.ply"):
        export_mesh(mesh, tmp_path / "mesh.obj")


def test_meshio_reads_the_vtu(mesh, tmp_path):
    meshio = pytest.importorskip("meshio", reason="needs meshio: pip install .[exchange]")
    grid = meshio.read(export_mesh(mesh, tmp_path / "mesh.vtu"))
    np.testing.assert_array_equal(grid.points, mesh.rest_vertices)
    np.testing.assert_array_equal(grid.cells_dict["tetra"], mesh.tets)
    np.testing.assert_array_equal(grid.point_data["vertex_id"], np.arange(mesh.vertex_count))


@pytest.mark.parametrize("ending", [".usda", ".usdc"])
def test_usd_reads_the_tets_and_the_material(mesh, tmp_path, ending):
    pytest.importorskip("pxr", reason="needs usd-core: pip install .[exchange]")
    from pxr import Usd, UsdGeom, UsdShade

    solid = Material(young_modulus=2e5, poisson_ratio=0.3, density=900.0)
    path = tmp_path / f"mesh{ending}"
    export_mesh(mesh, path, material=solid, meters_per_unit=0.25)
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.25
    tets = UsdGeom.TetMesh(stage.GetPrimAtPath("/Object/Tets"))
    points = np.array(tets.GetPointsAttr().Get())
    np.testing.assert_array_equal(points, mesh.rest_vertices.astype(np.float32))
    np.testing.assert_array_equal(np.array(tets.GetTetVertexIndicesAttr().Get()), mesh.tets)
    faces, _ = boundary_faces(mesh.tets, tet_neighbours(mesh.tets))
    stored = np.array(tets.GetSurfaceFaceVertexIndicesAttr().Get())
    np.testing.assert_array_equal(stored, faces)
    assert (signed_volumes(points.astype(float), mesh.tets) > 0.0).all()
    schemas = tets.GetPrim().GetMetadata("apiSchemas").GetAddedOrExplicitItems()
    assert {"PhysicsDeformableBodyAPI", "PhysicsVolumeDeformableSimAPI"} <= set(schemas)
    binding = UsdShade.MaterialBindingAPI(tets.GetPrim())
    material, _ = binding.ComputeBoundMaterial(materialPurpose="physics")
    assert material.GetPrim().GetAttribute("physics:youngsModulus").Get() == pytest.approx(2e5)
    assert material.GetPrim().GetAttribute("physics:poissonsRatio").Get() == pytest.approx(0.3)
    assert material.GetPrim().GetAttribute("physics:density").Get() == pytest.approx(900.0)
