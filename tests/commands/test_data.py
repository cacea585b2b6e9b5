"""deformrf data: photographs to train on, and a check of NeRF-synthetic's folders."""

import json
import os
from pathlib import Path

import pytest
from PIL import Image

from deformrf.commands import data as command

PHOTOGRAPHS = sorted(command.TOY.iterdir())


def test_the_toy_s_photographs_are_shipped():
    assert len(PHOTOGRAPHS) == 72
    for path in PHOTOGRAPHS:
        with Image.open(path) as image:
            image.load()
            assert image.format == "JPEG" and image.size == (480, 360)


@pytest.mark.parametrize("folder", [None, "new", "deep/er", "empty", "a b"])
def test_the_toy_is_written_into_a_folder(call, tmp_path, monkeypatch, folder):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    result = call(command.main, "toy", *([] if folder is None else [folder]))
    assert result.code == 0, result.err
    name = {None: "toy", "a b": "'a b'"}.get(folder, folder)
    assert f"Train on them: deformrf train {name} -o toy.npz --preset tiny\n" in result.out
    written = tmp_path / (folder or "toy")
    assert sorted(os.listdir(written)) == [path.name for path in PHOTOGRAPHS]
    for path in PHOTOGRAPHS:
        assert (written / path.name).read_bytes() == path.read_bytes()


def test_nothing_is_overwritten(call, tmp_path, refused):
    (tmp_path / "full").mkdir()
    kept = [tmp_path / "full" / "000.jpg", tmp_path / "file"]
    for path in kept:
        path.write_text("mine")
    for folder in (tmp_path / "full", tmp_path / "file"):
        assert "give a new or an empty folder" in refused(call(command.main, "toy", folder))
    assert [path.read_text() for path in kept] == ["mine", "mine"]
    assert os.listdir(tmp_path / "full") == ["000.jpg"]


def test_a_full_disk_leaves_no_photographs(call, tmp_path, monkeypatch, refused):
    copied = []

    def copyfile(source, target):
        copied.append(target)
        if len(copied) == 5:
            raise OSError(28, "No space left on device", str(target))
        Path(target).write_bytes(Path(source).read_bytes())

    monkeypatch.setattr(command.shutil, "copyfile", copyfile)
    result = call(command.main, "toy", tmp_path / "toy")
    assert "No space left" in refused(result)
    assert not os.listdir(tmp_path / "toy")


def test_the_origin_of_the_chair_is_said(call):
    result = call(command.main, "chair")
    assert result.code == 0 and result.err == ""
    assert command.PROJECT_PAGE in result.out and "deformrf data chair nerf_synth" in result.out


def test_a_data_set_is_counted(call, data):
    result = call(command.main, "chair", data)
    assert result.code == 0
    assert "3 of 3 training images are there, the first of 16x12 pixels." in result.out
    assert "2 of 2 test images are there" in result.out
    assert result.out.endswith(f"Train on them: deformrf train {data} -o data.npz\n")


def test_a_missing_image_is_named(call, data):
    (data / "test" / "r_1.png").unlink()
    result = call(command.main, "chair", data)
    assert result.code == 1
    assert "1 of 2 test images are there" in result.out and "test/r_1.png." in result.out
    assert "deformrf train" not in result.out


def no_folder(data):
    return data / "no"


def one_above(data):
    return data.parent


def no_test_split(data):
    (data / "transforms_test.json").unlink()
    return data


def no_images(data):
    for path in (data / "train").iterdir():
        path.unlink()
    return data


def damaged(data):
    path = data / "train" / "r_0.png"
    path.write_bytes(path.read_bytes()[:60])
    return data


def no_frames(data):
    (data / "transforms_train.json").write_text(json.dumps({"frames": 7}))
    return data


@pytest.mark.parametrize(
    "broken, sentence",
    [
        (no_folder, "is no folder"),
        (one_above, "without transforms_train.json: give "),
        (no_test_split, "without transforms_test.json"),
        (no_images, "none of the 3 train images is there"),
        (damaged, "r_0.png"),
        (no_frames, "lists no frames"),
    ],
)
def test_what_is_no_such_data_set_is_refused(call, data, refused, broken, sentence):
    assert sentence in refused(call(command.main, "chair", broken(data)))


def test_the_chair_itself(call, shared_data):
    result = call(command.main, "chair", shared_data("chair"))
    assert result.code == 0
    assert "100 of 100 training images are there, the first of 800x800 pixels." in result.out
