"""Scans of Polycam and Record3D: their cameras are those that the programs write."""

import json
import os

import numpy as np
import pytest
from PIL import Image
from posed_data import circle, polycam, put, record3d

from deformrf.commands.capturing import needs_cameras
from deformrf.core.training import DatasetError, has_cameras, load_dataset

LAYOUTS = {
    "polycam": polycam,
    "polycam's corrected": lambda f: polycam(f, names=("corrected_images", "corrected_cameras")),
    "record3d": record3d,
    "an unzipped .r3d": lambda f: record3d(f, names=("rgbd", "metadata")),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_poses_and_lenses_are_read(tmp_path, layout):
    folder = LAYOUTS[layout](tmp_path)
    assert has_cameras(folder) and not needs_cameras(folder)
    train, test = (load_dataset(folder, split) for split in ("train", "test"))
    assert (train.view_count, test.view_count) == (7, 2)
    np.testing.assert_allclose(train.poses, circle(9)[1:8], atol=1e-9)
    for lens in train.lenses:
        assert (lens.width, lens.height) == (30, 40)
        assert lens.focal == pytest.approx((40.0, 41.0))
        assert lens.center == pytest.approx((15.5, 21.0)) and not lens.is_distorted


def test_polycams_corrected_images_come_first(tmp_path):
    polycam(tmp_path)
    polycam(tmp_path, names=("corrected_images", "corrected_cameras"), size=(60, 80))
    (lens, *_) = load_dataset(tmp_path, "train").lenses
    assert (lens.width, lens.height) == (60, 80)
    assert load_dataset(tmp_path / "keyframes", "train").view_count == 7


def test_record3d_orders_frames_by_number_and_may_have_a_lens_for_each(tmp_path):
    coefficients = [[40.0 + i, 41.0 + i, 15.0, 20.0] for i in range(20)]
    record3d(tmp_path, count=20, perFrameIntrinsicCoeffs=coefficients)
    (tmp_path / "rgb/5.jpg").unlink()
    (tmp_path / "rgb/7 (3).jpg").write_bytes(b"a copy")
    data = load_dataset(tmp_path, "train")
    assert data.missing == ("rgb/5",)
    numbers = [int(name) for name in data.names]
    assert numbers == sorted(numbers) and numbers[-1] == 19
    assert [lens.focal[0] for lens in data.lenses] == [40.0 + number for number in numbers]
    np.testing.assert_allclose(data.poses, circle(20)[numbers], atol=1e-9)


def changed(path, **values):
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


@pytest.mark.parametrize(
    "values, sentence",
    [
        ({"t_00": None}, "the pose of 1001.jpg in .*1001.json has to be 4 rows"),
        ({"t_00": float("nan")}, "has to be 4 rows of 4 finite numbers"),
        ({"t_00": 0.0, "t_10": 0.0, "t_20": 0.0}, "an axis has no length"),
        ({"fx": "wide"}, "1001.json lacks numbers of the camera of 1001.jpg"),
        ({"width": 0}, "lacks numbers of the camera"),
        ({"height": 10**400}, "lacks numbers of the camera"),
        ({"width": 40, "height": 30}, "says that images have 40x30 pixels, but 1001.jpg has 30x40"),
        ({"cx": 900.0}, "lies outside the image"),
    ],
)
def test_damaged_cameras_of_polycam_are_refused_in_one_sentence(tmp_path, values, sentence):
    folder = polycam(tmp_path)
    changed(folder / "keyframes/cameras/1001.json", **values)
    with pytest.raises(DatasetError, match=sentence) as caught:
        load_dataset(folder, "train")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "values, sentence",
    [
        ({"poses": None}, "has no list of poses"),
        ({"poses": [[0, 0, 0, 0, 1, 2, 3]]}, "pose 0 of .* has no rotation: .* length 0"),
        ({"poses": [[0, 0, 0, 1]]}, "pose 0 of .* is no quaternion"),
        ({"poses": [{"a": 1}]}, "pose 0 of .* is no quaternion"),
        ({"poses": [[0, 0, 0, 10**400, 1, 2, 3]]}, "pose 0 of .* has no rotation: .* inf"),
        ({"K": None}, "has no fx, fy, cx, cy of image 0"),
        ({"K": [1, 2]}, "K that is no list of 9"),
        ({"K": ["a"] * 9}, "lacks numbers of the camera of 0.jpg"),
        ({"w": None}, "lacks numbers of the camera of 0.jpg"),
    ],
)
def test_damaged_metadata_of_record3d_are_refused_in_one_sentence(tmp_path, values, sentence):
    folder = record3d(tmp_path)
    changed(folder / "metadata.json", **values)
    with pytest.raises(DatasetError, match=sentence) as caught:
        load_dataset(folder, "train")
    assert "\n" not in str(caught.value)


def test_a_pipe_is_no_camera(tmp_path):
    """Nobody writes to it: reading would never end."""
    folder = polycam(tmp_path)
    os.mkfifo(folder / "keyframes/cameras/pipe.json")
    Image.new("RGB", (30, 40)).save(folder / "keyframes/images/pipe.jpg")
    with pytest.raises(DatasetError, match=r"pipe\.json can.t be read: it is a pipe"):
        load_dataset(folder, "train")


@pytest.mark.parametrize("content", ["", "{", "[1]", "[" * 100_000, "\ud800"])
def test_what_is_no_json_is_refused(tmp_path, content):
    folder = record3d(tmp_path)
    (folder / "metadata.json").write_bytes(content.encode("utf-8", "surrogatepass"))
    with pytest.raises(DatasetError, match=r"metadata\.json"):
        load_dataset(folder, "train")


NASTY = None, True, -1, 0, 1e-320, 1e308, 10**400, float("nan"), "", "a\0", [], {}, [[1e300] * 4]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("make", [polycam, record3d])
def test_whatever_a_scan_holds_it_is_read_or_refused(tmp_path, make):
    """Up to three of its numbers are replaced by nasty values."""
    rng, folder, counts = np.random.default_rng(), make(tmp_path, count=3), {True: 0, False: 0}
    file = "keyframes/cameras/1001.json" if make is polycam else "metadata.json"
    text = (folder / file).read_text()
    for _ in range(150):
        values = json.loads(text)
        for _ in range(rng.integers(1, 4)):
            holder = values
            while isinstance(holder, dict | list) and len(holder):
                keys = list(holder) if isinstance(holder, dict) else range(len(holder))
                key, place = keys[rng.integers(len(keys))], holder
                holder = holder[key]
            place[key] = json.loads(json.dumps(NASTY[rng.integers(len(NASTY))]))
        (folder / file).write_text(json.dumps(values))
        try:
            load_dataset(folder, "train")
            counts[True] += 1
        except DatasetError as error:
            counts[False] += 1
            assert "\n" not in str(error)
    assert min(counts.values()) > 2, counts


@pytest.mark.parametrize("name", ["scan.r3d", "scan-poly.zip"])
def test_an_archive_is_to_be_unzipped(tmp_path, name):
    (tmp_path / name).write_bytes(b"PK")
    with pytest.raises(DatasetError, match=f"{name} is .*: unzip it"):
        load_dataset(tmp_path / name, "train")


def test_two_folders_of_photographs_without_cameras_are_none(tmp_path):
    for name in ("rgb", "images"):
        put(tmp_path / name / "0.jpg")
    assert not has_cameras(tmp_path)


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_a_camera_that_is_no_file_is_neither_waited_for_nor_read(tmp_path, kind):
    polycam(tmp_path)
    path = tmp_path / "keyframes/cameras/1003.json"
    path.unlink()
    os.mkfifo(path) if kind == "pipe" else path.symlink_to("/dev/zero")
    with pytest.raises(DatasetError, match=rf"1003\.json can't be read: it is a {kind}"):
        load_dataset(tmp_path, "train")
