"""Poses of films that don't move: vertices of files, the end of a session."""

import io
import zipfile

import numpy as np
import pytest

from deformrf.viewer.document import Scene, save_session, start_of
from deformrf.viewer.films import Film
from deformrf.viewer.films.still import PoseError, load_vertices


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


@pytest.mark.parametrize("name", ["pose.npy", "pose.npz"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_vertices_of_a_file_are_the_pose(scene, tmp_path, name, dtype):
    path, vertices = tmp_path / name, (1.2 * scene.positions).astype(dtype)
    if path.suffix == ".npy":
        np.save(path, np.asfortranarray(vertices))
    else:
        np.savez_compressed(path, other=np.zeros(3), vertices=vertices)
    Film(scene, None, 30).strike(path)
    np.testing.assert_allclose(scene.positions, vertices, atol=1e-6)


def test_the_last_pose_of_a_session_is_the_pose(scene, ball, tmp_path):
    start = start_of(scene)
    scene.handles.grab(int(scene.handles.control_ids[0]))
    place = scene.handles.grabbed.target.place
    for tick in range(10):
        scene.handles.drag_to(np.add(place, [0.0, 0.0, 0.01 * tick]))
        scene.clock.advance(1 / 60)
    other = Scene(ball, "ball", "cpu")
    Film(other, None, 30).strike(save_session(scene, start, tmp_path / "s.jsonl"))
    assert np.array_equal(other.positions, scene.positions)
    assert other.handles.grabbed is None


def huge_header():
    """An array's file that says that it has a terabyte."""
    stream = io.BytesIO()
    header = {"shape": (2**38, 3), "fortran_order": False, "descr": "<f4"}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue()


@pytest.mark.parametrize(
    "name, content, sentence",
    [
        ("a.npy", b"no array", "has no pose of 9 vertices"),
        ("a.npy", huge_header(), "it has (274877906944, 3)"),
        ("a.npz", b"no archive", "has no pose of 9 vertices"),
        ("a.txt", b"", "is in a file .npy, .npz or .jsonl"),
        ("a.npy", np.zeros((9, 3), np.int64), "it has (9, 3) of int64"),
        ("a.npy", np.full((9, 3), np.nan), "or no numbers"),
        ("a.npy", np.full((9, 3), 1e9), "vertices farther than 1000"),
        ("a.npz", np.zeros((8, 3)), "it has (8, 3)"),
        ("a.npz", {}, "There is no item named 'vertices.npy'"),
    ],
)
def test_a_file_without_a_pose_is_refused(tmp_path, name, content, sentence):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif name.endswith(".npz"):
        np.savez(path, **({} if isinstance(content, dict) else {"vertices": content}))
    else:
        np.save(path, content)
    with pytest.raises(PoseError) as raised:
        load_vertices(path, 9)
    assert sentence in str(raised.value) and "\n" not in str(raised.value)


def test_an_array_that_ends_too_soon_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((9, 3)))
    whole = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(whole[:-8])
    with pytest.raises(PoseError, match="ends too soon"):
        load_vertices(tmp_path / "a.npy", 9)
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        archive.writestr("vertices.npy", whole[:-8])
    with pytest.raises(PoseError, match="ends too soon"):
        load_vertices(tmp_path / "b.npz", 9)


@pytest.mark.parametrize("place, value", [(6, 1), (8, 99), (60, 255)])
def test_a_damaged_archive_is_refused(tmp_path, place, value):
    """Its data are no stream of zlib, their method is unknown, or a password is asked for."""
    path = tmp_path / "a.npz"
    np.savez_compressed(path, vertices=np.zeros((9, 3), np.float32))
    data = bytearray(path.read_bytes())
    in_list = data.rindex(b"PK\x01\x02")
    if place < 60:  # the archive's list of files says it, too
        data[in_list + place + 2] = value
    data[place : place + 9] = bytes([value]) * 9 if place == 60 else data[place : place + 9]
    if place < 60:
        data[place] = value
    path.write_bytes(data)
    with pytest.raises(PoseError, match="has no pose of 9 vertices"):
        load_vertices(path, 9)
