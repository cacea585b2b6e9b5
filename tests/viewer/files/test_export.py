"""Meshes for other programs, read again by parsers of the tests' own."""

import struct

import numpy as np
import pytest

from deformrf.core.geometry import signed_volumes
from deformrf.core.render.preview import GRAY
from deformrf.viewer.files import export as e


@pytest.fixture
def posed(ball):
    """The surface of a bent ball, and the positions of all vertices."""
    rest = ball.mesh.rest_vertices.astype(float)
    bent = rest + 0.2 * np.sin(3.0 * rest[:, [2]]) * [1.0, 0.0, 0.0]
    return e.surface_of(ball.mesh.tets, ball.neighbours, bent), bent


def read_ply(path):
    """Vertices, colors (or None) and faces of a binary PLY with triangles."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    counts = {line.split()[1]: int(line.split()[2]) for line in lines if line[:8] == "element "}
    colored = "property uchar red" in lines
    vertices, colors, faces, at = [], [], [], 0
    for _ in range(counts["vertex"]):
        vertices.append(struct.unpack_from("<3f", body, at))
        at += 12
        if colored:
            colors.append(struct.unpack_from("<3B", body, at))
            at += 3
    for _ in range(counts["face"]):
        count, *ids = struct.unpack_from("<B3i", body, at)
        assert count == 3
        faces.append(ids)
        at += 13
    assert at == len(body)
    return np.float32(vertices), np.uint8(colors) if colored else None, np.array(faces)


def read_obj(path):
    """The same of an OBJ."""
    rows = [line.split() for line in path.read_text().splitlines() if line[:1] in "vf"]
    numbers = np.array([[float(x) for x in row[1:]] for row in rows if row[0] == "v"])
    faces = np.array([[int(x) for x in row[1:]] for row in rows if row[0] == "f"]) - 1
    colors = np.round(255.0 * numbers[:, 3:]).astype(np.uint8) if numbers.shape[1] == 6 else None
    return np.float32(numbers[:, :3]), colors, faces


READ = {".ply": read_ply, ".obj": read_obj}


@pytest.mark.parametrize("ending, sign", [(".ply", "comment"), (".obj", "#")])
def test_a_file_states_who_made_the_object(posed, tmp_path, ending, sign):
    path = e.save_surface(posed[0], tmp_path / f"mesh{ending}", "Mesh by Öya, CC BY 4.0")
    assert f"\n{sign} Mesh by \\xd6ya, CC BY 4.0\n".encode() in path.read_bytes()
    np.testing.assert_array_equal(READ[ending](path)[2], posed[0].faces)


@pytest.mark.parametrize("colored", [False, True])
@pytest.mark.parametrize("ending", e.ENDINGS)
def test_another_program_reads_what_was_written(posed, tmp_path, ending, colored):
    surface, _ = posed
    if colored:
        colors = np.random.default_rng().integers(0, 256, surface.vertices.shape, np.uint8)
        surface = e.SurfaceMesh(surface.vertices, surface.faces, colors)
    vertices, colors, faces = READ[ending](e.save_surface(surface, tmp_path / f"mesh{ending}"))
    np.testing.assert_array_equal(vertices, surface.vertices)
    np.testing.assert_array_equal(faces, surface.faces)
    if colored:
        np.testing.assert_array_equal(colors, surface.colors)
    else:
        assert colors is None


def test_the_surface_is_closed_and_encloses_the_tets_in_their_pose(posed, ball):
    surface, bent = posed
    sides = np.sort(surface.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(sides, axis=0, return_counts=True)
    assert (counts % 2 == 0).all()
    a, b, c = surface.vertices.astype(float)[surface.faces].transpose(1, 0, 2)
    enclosed = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert enclosed == pytest.approx(signed_volumes(bent, ball.mesh.tets).sum(), rel=1e-5)
    assert enclosed > 0.0  # so corners are counterclockwise from outside
    assert set(np.unique(surface.faces)) == set(range(len(surface.vertices)))


def test_normals_point_outwards(posed, ball):
    surface = e.surface_of(ball.mesh.tets, ball.neighbours, ball.mesh.rest_vertices)
    normals = e.vertex_normals(surface.vertices, surface.faces)
    outwards = surface.vertices - surface.vertices.mean(axis=0)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-5)
    assert ((normals * outwards).sum(axis=1) > 0.0).mean() > 0.9


def test_colors_are_those_that_are_seen(ball):
    from deformrf.core.render import Renderer

    surface = e.surface_of(ball.mesh.tets, ball.neighbours, ball.mesh.rest_vertices)
    renderer = Renderer(ball)
    renderer.set_vertices(ball.mesh.rest_vertices)
    colored = e.with_colors(surface, renderer, 0.6)
    normals = e.vertex_normals(surface.vertices, surface.faces)
    start = surface.vertices + 0.5 * normals  # from afar the same is seen
    color, opacity, _ = renderer.render_rays(start, -normals)
    opaque = opacity > 0.99
    assert opaque.mean() > 0.2
    assert abs(colored.colors[opaque] - 255.0 * color[opaque]).mean() < 8.0
    assert (colored.colors[opacity < 0.4] == GRAY).all()


def test_a_pose_without_numbers_is_refused(ball):
    positions = ball.mesh.rest_vertices.copy()
    positions[:] = np.nan
    with pytest.raises(ValueError, match="reset it"):
        e.surface_of(ball.mesh.tets, ball.neighbours, positions)


def test_another_ending_is_refused_and_a_full_disk_leaves_the_older_file(
    posed, tmp_path, monkeypatch
):
    surface, _ = posed
    with pytest.raises(ValueError, match="end in"):
        e.save_surface(surface, tmp_path / "mesh.stl")
    path = tmp_path / "mesh.ply"
    path.write_text("older")
    from pathlib import Path

    def full(self, content):
        self.open("wb").write(content[:100])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError):
        e.save_surface(surface, path)
    assert path.read_text() == "older" and list(tmp_path.iterdir()) == [path]


@pytest.mark.gl
def test_the_menu_writes_the_mesh_as_it_is_bent(window, ball, monkeypatch, tmp_path):
    from deformrf.viewer.actions import ACTIONS
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    app = App(*window, EventLog(False), gui=False)
    app.load(ball, "ball", "cpu")
    app.frame(0.0)
    app.scene.set_gravity(9.81)
    for _ in range(10):
        app.frame(1 / 30)
    for action in ("export_ply", "export_obj"):
        ACTIONS[action](app)
    bent = e.surface_of(ball.mesh.tets, ball.neighbours, app.scene.solver.vertices.numpy())
    for path in app.recorder.written:
        vertices, colors, _ = READ[path.suffix](path)
        np.testing.assert_allclose(vertices, bent.vertices, atol=1e-6)
        assert colors.std() > 0
    assert {path.suffix for path in app.recorder.written} == {".ply", ".obj"}
    app.close()
