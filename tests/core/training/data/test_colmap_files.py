"""The files of COLMAP's models, which anybody may have written."""

import struct

import numpy as np
import pytest
from colmap_files import (
    MODELS,
    WRITERS,
    Sparse,
    cameras_bytes,
    images_bytes,
    images_text,
    points_bytes,
    some_sparse,
    write_binary,
)
from peak_memory import peak_memory

from deformrf.core.training import DatasetError
from deformrf.core.training.data import colmap_files as files
from deformrf.core.training.data.posed_images import rigid_pose

ENDINGS = pytest.mark.parametrize("ending", ["bin", "txt"])
READERS = {
    "cameras": files.read_cameras,
    "images": files.read_images,
    "points3D": files.read_points,
}
NAMES = [
    "A-DJI V_map-plan wp-2 (402).jpg", "ümläut Größe 3.jpg", "左/写真 1.jpg", "cam a/b  c/1.jpg",
    "plain.jpg", "0001.jpg", "x (1).jpg", "1 2 3.png", "a\u00a0b\u3000c.png", "# no comment.png",
]  # fmt: skip


def sparse_of_all_models():
    cameras = {
        7 * i + 1: (name, 16 + i, 12, tuple(map(float, range(1, count + 1))))
        for i, (name, (_, count)) in enumerate(MODELS.items())
    }
    return some_sparse(NAMES, cameras, point_count=50)


def refused(read, path, sentence="."):
    """The DatasetError's sentence, which names the file."""
    with pytest.raises(DatasetError, match=sentence) as caught:
        read(path)
    line = str(caught.value)
    assert str(path) in line and "\n" not in line and len(line) < len(str(path)) + 400, line
    return line


@ENDINGS
def test_what_was_written_is_read(tmp_path, ending):
    sparse = sparse_of_all_models()
    WRITERS[ending](sparse, tmp_path)
    cameras = files.read_cameras(tmp_path / f"cameras.{ending}")
    assert {k: (c.model, c.width, c.height, c.parameters) for k, c in cameras.items()} == (
        sparse.cameras
    )
    images = files.read_images(tmp_path / f"images.{ending}")
    assert [image.name for image in images] == sorted(NAMES)
    written = {name: (camera, pose) for _, pose, camera, name, _ in sparse.images}
    for image in images:
        camera, (*_, x, y, z) = written[image.name]
        assert image.camera == camera
        np.testing.assert_array_equal(image.world_to_camera[:3, 3], [x, y, z])
    points = files.read_points(tmp_path / f"points3D.{ending}")
    np.testing.assert_array_equal(points, [xyz for _, xyz, *_ in sparse.points])


@ENDINGS
def test_colmap_reads_the_same(tmp_path, ending):
    """Poses, cameras and points as its own reader has them; and what it writes, rigs and frames."""
    pycolmap = pytest.importorskip("pycolmap")
    names = [f"{i}.png" for i in range(9)]  # its reader of text cuts names at spaces
    WRITERS[ending](some_sparse(names), tmp_path / "ours")
    theirs = pycolmap.Reconstruction(str(tmp_path / "ours"))
    (tmp_path / "theirs").mkdir()
    getattr(theirs, {"bin": "write_binary", "txt": "write_text"}[ending])(str(tmp_path / "theirs"))
    assert (tmp_path / f"theirs/rigs.{ending}").is_file()
    for folder in ("ours", "theirs"):
        images = files.read_images(tmp_path / folder / f"images.{ending}")
        poses = {image.name: image.cam_from_world().matrix() for image in theirs.images.values()}
        assert {image.name for image in images} == set(poses) == set(names)
        for image in images:
            np.testing.assert_allclose(image.world_to_camera[:3], poses[image.name], atol=1e-12)
        cameras = files.read_cameras(tmp_path / folder / f"cameras.{ending}")
        assert {key: tuple(camera.params) for key, camera in theirs.cameras.items()} == {
            key: camera.parameters for key, camera in cameras.items()
        }
        points = files.read_points(tmp_path / folder / f"points3D.{ending}")
        expected = [point.xyz for point in theirs.points3D.values()]
        assert sorted(map(tuple, points)) == sorted(map(tuple, expected))


def test_colmaps_camera_models_are_known():
    pycolmap = pytest.importorskip("pycolmap")
    for number, (name, count) in enumerate(files.MODELS):
        camera = pycolmap.Camera.create_from_model_name(1, name, 100.0, 100, 100)
        assert (int(camera.model), len(camera.params)) == (number, count)


@pytest.mark.parametrize("length", [0.01, 1.0, 300.0])
def test_quaternions_of_any_length_are_rotations(length):
    rng = np.random.default_rng()
    quaternion = rng.normal(size=4)
    w, x, y, z = length * quaternion / np.linalg.norm(quaternion)
    matrix = files.matrix_of([w, x, y, z, 1.0, 2.0, 3.0], "a pose")
    np.testing.assert_allclose(rigid_pose(matrix, ""), matrix, atol=1e-12)
    axis, angle = np.array([x, y, z]), 2 * np.arctan2(np.hypot(np.hypot(x, y), z), w)
    np.testing.assert_allclose(matrix[:3, :3] @ axis, axis, atol=1e-9 * length)
    assert np.trace(matrix[:3, :3]) == pytest.approx(1 + 2 * np.cos(angle))


# -- text that others write ------------------------------------------------------------------------


def without_last_line_end(text):
    return text.rstrip("\n")


def without_feature_lines(text):
    """As programs write it that have no features."""
    return "".join(line + "\n" for line in text.splitlines() if "x (1)" in line or ".png" in line)


TEXTS = {
    "as COLMAP": lambda text: text,
    "no last line": without_last_line_end,
    "line ends of Windows": lambda text: text.replace("\n", "\r\n"),
    "byte order mark": lambda text: "\ufeff" + text,
    "a mark before numbers": lambda text: "\ufeff" + text[text.index("\n1 ") + 1 :],
    "no lines of features": without_feature_lines,
    "blank lines between": lambda text: text.replace(".png\n", ".png\n\n\n") + "\n\n",
    "comments between": lambda text: text.replace(".png\n", ".png\n# features\n"),
    "tabs": lambda text: text.replace(" 1 ", "\t1\t"),
    "spaces around": lambda text: "".join(f"  {line}  \n" for line in text.splitlines()),
    "long lines of features": lambda text: "\n".join(
        [*text.split("\n")[:-2], "1.5 2.5 -1 " * 20_000, ""]
    ),
}


@pytest.mark.parametrize("name", ["0001", "12 3"])
@pytest.mark.parametrize("has_features", [True, False])
def test_names_of_numbers_alone_are_no_features(tmp_path, name, has_features):
    rows = []
    for i in range(4):
        rows.append(f"{i + 1} 1 0 0 0 0 0 {i} 1 {name}{i}")
        rows += ["10.5 20.5 -1 3 4 5 7 8 9 1 2 3"] if has_features else []
    (tmp_path / "images.txt").write_text("\n".join(rows) + "\n")
    found = [image.name for image in files.read_images(tmp_path / "images.txt")]
    assert found == [f"{name}{i}" for i in range(4)]


@pytest.mark.parametrize("features", [True, False])
@pytest.mark.parametrize("kind", TEXTS)
def test_text_of_other_writers_is_read_whole(tmp_path, kind, features):
    names = ["b 2.png", "a.png", "x (1) c.png"]
    sparse = some_sparse(names, point_count=8 if features else 0)
    if not features:
        sparse.images = [(*image[:4], []) for image in sparse.images]
    if kind == "blank lines between":
        sparse.images = [(*image[:4], []) for image in sparse.images]
    path = tmp_path / "images.txt"
    path.write_bytes(TEXTS[kind](images_text(sparse)).encode())
    assert [image.name for image in files.read_images(path)] == sorted(names)


def test_points_with_tracks_of_any_length_are_read(tmp_path):
    sparse = some_sparse(["a.png"], point_count=9)
    for i, point in enumerate(sparse.points):
        point[4].extend([(1, k) for k in range(0, 30_000 * (i % 3))])
    for ending in ("bin", "txt"):
        WRITERS[ending](sparse, tmp_path)
        points = files.read_points(tmp_path / f"points3D.{ending}")
        np.testing.assert_array_equal(points, [xyz for _, xyz, *_ in sparse.points])


@pytest.mark.parametrize("block", [51, 64, 200, 2**22])
def test_points_are_the_same_in_blocks_of_any_size(tmp_path, monkeypatch, block):
    sparse = sparse_of_all_models()
    write_binary(sparse, tmp_path)
    monkeypatch.setattr(files, "BLOCK", block)
    points = files.read_points(tmp_path / "points3D.bin")
    np.testing.assert_array_equal(points, [xyz for _, xyz, *_ in sparse.points])


# -- damage ------------------------------------------------------------------------------------


BYTES = {"cameras": cameras_bytes, "images": images_bytes, "points3D": points_bytes}


@pytest.mark.parametrize("name", BYTES)
def test_a_binary_file_that_was_cut_off_anywhere_is_refused(tmp_path, name):
    sparse = some_sparse(["a.png", "b.png"], point_count=4)
    path, whole = tmp_path / f"{name}.bin", BYTES[name](sparse)
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        refused(READERS[name], path, "is cut off")
    path.write_bytes(whole + b"\0")
    refused(READERS[name], path, f"end at byte {len(whole)}, and it has {len(whole) + 1}")


@pytest.mark.parametrize("name", BYTES)
@pytest.mark.parametrize("count", [5, 2**20, 2**31, 2**63, 2**64 - 1])
def test_counts_are_compared_with_the_size_before_memory_is_taken(tmp_path, name, count):
    sparse = some_sparse(["a.png", "b.png"], point_count=4)
    path, whole = tmp_path / f"{name}.bin", BYTES[name](sparse)
    path.write_bytes(struct.pack("<Q", count) + whole[8:])
    assert peak_memory(lambda: refused(READERS[name], path)) < 10e6


@pytest.mark.parametrize("count", [2**20, 2**40, 2**64 - 1])
def test_counts_of_features_and_tracks_are_compared_with_the_size(tmp_path, count):
    sparse = some_sparse(["a.png"], point_count=1)
    number, pose, camera, name, _ = sparse.images[0]
    images = images_bytes(Sparse(images=[(number, pose, camera, name, [])]))
    (tmp_path / "images.bin").write_bytes(images[:-8] + struct.pack("<Q", count))
    refused(files.read_images, tmp_path / "images.bin", f"counts {count} features")
    sparse.points = [(*sparse.points[0][:4], [])]
    points = points_bytes(sparse)
    (tmp_path / "points3D.bin").write_bytes(points[:-8] + struct.pack("<Q", count))
    refused(files.read_points, tmp_path / "points3D.bin", "is cut off or damaged")


def test_files_of_zeros_are_refused_at_once(tmp_path):
    """They take no space on the disk, and may have any size."""
    for name, read in READERS.items():
        for ending in ("bin", "txt"):
            path = tmp_path / f"{name}.{ending}"
            with path.open("wb") as stream:
                stream.write(struct.pack("<Q", 2**27))
                stream.truncate(2**34)
            refused(read, path)


def image_with(**changes):
    """images.bin of two images, one of which has other values."""
    sparse = some_sparse(["a.png", "b.png"], point_count=3)
    number, pose, camera, name, features = sparse.images[1]
    pose = changes.get("pose", pose)
    number, name = changes.get("number", number), changes.get("name", name)
    sparse.images[1] = (number, pose, camera, name, features)
    return sparse


@pytest.mark.parametrize(
    "changes, sentence",
    [
        ({"number": 1}, "two images with the number 1"),
        ({"name": "a.png"}, "two images with the name a.png"),
        ({"name": "a" * 5000}, "the name .* has no end|has two|a{50}"),
        ({"pose": (0.0,) * 7}, "no rotation"),
        ({"pose": (float("nan"), 0.0, 0.0, 0.0, 1.0, 1.0, 1.0)}, "no rotation"),
        ({"pose": (1.0, 0.0, 0.0, 0.0, float("inf"), 1.0, 1.0)}, "pose of b.png.*finite"),
        ({"pose": (1.0, 0.0, 0.0, 0.0, 1e300, 1.0, 1.0)}, "pose of b.png.*finite"),
        ({"pose": (1e308, 1e308, 1e308, 1e308, 0.0, 1.0, 1.0)}, "no rotation"),
    ],
    ids=["number", "name", "long name", "zero", "nan", "infinite", "far", "huge"],
)
@ENDINGS
def test_impossible_images_are_refused(tmp_path, ending, changes, sentence):
    WRITERS[ending](image_with(**changes), tmp_path)
    path = tmp_path / f"images.{ending}"
    if ending == "txt" and "aaaa" in changes.get("name", ""):
        assert len(files.read_images(path)) == 2  # COLMAP's text has no such limit
        return
    refused(files.read_images, path, sentence)


@pytest.mark.parametrize("name", ["", "\udcff"], ids=["empty", "no UTF-8"])
def test_names_that_are_none_are_refused(tmp_path, name):
    whole = images_bytes(some_sparse(["a.png", "b.png"], point_count=0))
    path = tmp_path / "images.bin"
    path.write_bytes(whole.replace(b"b.png", name.encode(errors="surrogateescape")))
    refused(files.read_images, path, "name")


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("1 PINHOLE 16 12 20 21 8", "has 3 parameters for camera 1, and PINHOLE has 4"),
        ("1 PINHOLE 16 -12 20 21 8 6", "16x-12"),
        ("1 PINHOLE 16 12 20 x 8 6", "with numbers in line 2"),
        ("one PINHOLE 16 12 20 21 8 6", "with numbers in line 2"),
        ("1 PINHOLE 16", "number model width height parameters' in line 2"),
        ("1 PINHOLE 16 12 20 21 8 6\n1 PINHOLE 16 12 20 21 8 6", "two cameras with the number 1"),
        ("1 PINHOLE 16 12 20 21 8 6\0", "not a text file"),
        ("1 PINHOLE 16 12 " + "1 " * 20_000, "line 2"),
    ],
)
def test_bad_lines_of_cameras_are_named(tmp_path, text, sentence):
    path = tmp_path / "cameras.txt"
    path.write_text("# cameras\n" + text)
    refused(files.read_cameras, path, sentence)


@pytest.mark.parametrize(
    "line", ["1 1 0 0 0 0 0 0 1", "1 1 0 0 0 0 0 0 x a.png", "1 2 3", "GPS a b"]
)
def test_bad_lines_of_images_are_named(tmp_path, line):
    path = tmp_path / "images.txt"
    path.write_text(f"# images\n{line}\n")
    refused(files.read_images, path, "in line 2")
    path.write_text("# images\n")
    refused(files.read_images, path, "no registered images")


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e300])
@ENDINGS
def test_points_nowhere_are_refused(tmp_path, ending, value):
    sparse = some_sparse(["a.png"], point_count=3)
    number, _, *rest = sparse.points[1]
    sparse.points[1] = (number, (0.0, float(value), 0.0), *rest)
    WRITERS[ending](sparse, tmp_path)
    refused(files.read_points, tmp_path / f"points3D.{ending}", "no finite numbers")


@ENDINGS
def test_an_unknown_camera_model(tmp_path, ending):
    """In a binary file nobody knows how long its record is; in text another camera may be used."""
    if ending == "bin":
        data = struct.pack("<QIiQQ", 1, 1, 99, 16, 12) + bytes(64)
        (tmp_path / "cameras.bin").write_bytes(data)
        refused(files.read_cameras, tmp_path / "cameras.bin", "the number 99")
    else:
        (tmp_path / "cameras.txt").write_text("1 PINHOLE 9 9 9 9 4 4\n2 SPLINE 9 9 1 2 3\n")
        assert files.read_cameras(tmp_path / "cameras.txt")[2].model == "SPLINE"


@pytest.mark.parametrize("name", READERS)
@ENDINGS
def test_damaged_files_are_read_or_refused_in_one_sentence(tmp_path, name, ending):
    rng = np.random.default_rng()
    WRITERS[ending](some_sparse(["a b.png", "c.png", "d.png"], point_count=6), tmp_path)
    path = tmp_path / f"{name}.{ending}"
    whole = path.read_bytes()
    for _ in range(300):
        data = bytearray(whole)
        for place in rng.integers(0, len(data), rng.integers(1, 4)):
            data[place] = rng.choice([0, 255, 32, 10, 45, rng.integers(256)])
        if rng.random() < 0.3:
            first, last = sorted(rng.integers(0, len(data), 2))
            data[first:last] = data[first:last] * int(rng.integers(0, 4))
        path.write_bytes(data)
        try:
            READERS[name](path)
        except DatasetError as error:
            assert str(path) in str(error) and "\n" not in str(error)


def test_what_is_missing_or_a_folder_is_one_sentence(tmp_path):
    for name, read in READERS.items():
        refused(read, tmp_path / f"{name}.bin", "No such file")
        (tmp_path / f"{name}.txt").mkdir()
        refused(read, tmp_path / f"{name}.txt", "Is a directory")
