"""Data sets that lie deeper in a folder than they are read from."""

import json
import shutil

import numpy as np
import pytest
from colmap_files import write_capture
from posed_data import PHONE, nsvf, put, transforms

from deformrf.commands import train
from deformrf.commands.capturing import needs_cameras
from deformrf.core.training import DatasetError, load_dataset


def blender(folder):
    """Images beside their transforms.json."""
    transforms(folder, **PHONE)
    for path in (folder / "images").iterdir():
        path.rename(folder / path.name)
    return folder


WRITERS = {
    "transforms.json": lambda folder: transforms(folder, **PHONE),
    "images beside it": blender,
    "NSVF": nsvf,
    "COLMAP": write_capture,
}


@pytest.mark.parametrize("wrap", ["lego", "archive/nerf synthetic/lego"])
@pytest.mark.parametrize("kind", WRITERS)
def test_folders_around_a_data_set_are_told_of(call, tmp_path, refused, kind, wrap):
    data = tmp_path / "data"
    WRITERS[kind](data / wrap)
    sentence = refused(call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu"))
    assert f"{data} has no cameras itself, but {data / wrap} has: give that folder" in sentence
    assert not (tmp_path / "m.capture").exists()  # nor were cameras sought anew


def test_several_data_sets_are_named(tmp_path):
    for name in ("a", "b", "c"):
        transforms(tmp_path / name, **PHONE)
    with pytest.raises(DatasetError, match=r"3 folders in it have \(a, b, c\): give one of them"):
        load_dataset(tmp_path, "train")


@pytest.mark.parametrize("place", ["0", "colmap/text", "distorted/sparse/0", "dense/sparse"])
def test_a_colmap_model_in_another_place_is_not_passed_over(tmp_path, place):
    write_capture(tmp_path, place=place)
    with pytest.raises(DatasetError) as caught:
        needs_cameras(tmp_path)
    moved = tmp_path / "sparse/0"
    assert f"lie in {tmp_path / place}, where they are not read: move" in str(caught.value)
    assert str(caught.value).endswith(str(moved))
    moved.parent.mkdir()
    shutil.copytree(tmp_path / place, moved)  # what the sentence says helps
    assert not needs_cameras(tmp_path) and load_dataset(tmp_path, "train").view_count


def test_photographs_without_cameras_are_not_refused(tmp_path):
    put(tmp_path / "photos/a.jpg")
    assert needs_cameras(tmp_path)
    transforms(tmp_path / "photos/model.capture", **PHONE)  # a run's own work
    assert needs_cameras(tmp_path)
    transforms(tmp_path / "photos/clip-frames", **PHONE)
    assert needs_cameras(tmp_path / "photos")  # it holds photographs itself


def test_cameras_in_a_form_that_is_not_read_are_told_of(call, tmp_path):
    put(tmp_path / "data/images/a.jpg")
    (tmp_path / "data/poses_bounds.npy").write_bytes(b"-")
    result = call(train.main, tmp_path / "data", "-o", tmp_path / "m.npz")
    assert "poses_bounds.npy may have the photographs' cameras, but is not read" in result.out
    assert result.code == 2 and "1 photograph, and at least 8 are needed" in result.err


def test_the_check_counts_missing_images(call, tmp_path, refused):
    transforms(tmp_path / "data", **PHONE)
    paths = sorted((tmp_path / "data/images").iterdir())
    paths[3].unlink()
    command = (tmp_path / "data", "-o", tmp_path / "m.npz", "--check")
    result = call(train.main, *command)
    assert result.code == 0 and "1 of 7 train images are missing" in result.err
    for path in paths[:3] + paths[4:]:
        path.unlink()
    assert "none of the 7 train images is there" in refused(call(train.main, *command))


@pytest.mark.parametrize("wrong", ["OpenCV's axes", "world to camera"])
def test_cameras_that_look_elsewhere_are_told_of(call, tmp_path, refused, wrong):
    transforms(tmp_path / "data", **PHONE)
    path = tmp_path / "data/transforms.json"
    scene, opencv = json.loads(path.read_text()), wrong == "OpenCV's axes"
    for frame in scene["frames"]:
        matrix = np.array(frame["transform_matrix"])
        matrix = matrix * [1, -1, -1, 1] if opencv else np.linalg.inv(matrix)
        frame["transform_matrix"] = matrix.tolist()
    path.write_text(json.dumps(scene))
    command = (tmp_path / "data", "-o", tmp_path / "m.npz", "--device", "cpu")
    hint = "column negated" if opencv else "world-to-camera matrices have to be inverted"
    assert hint in refused(call(train.main, *command))
    result = call(train.main, *command, "--check")
    assert result.code == 0 and hint in result.out
