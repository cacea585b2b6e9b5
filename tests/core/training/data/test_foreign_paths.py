"""Names of files as other machines write them: which file each means, and which it never does."""

import json
import os
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from posed_data import PHONE, circle, colmap, put, transforms, write_frames

from deformrf.commands import running
from deformrf.core.training import DatasetError, NoImagesError, load_dataset
from deformrf.core.training.data import foreign_paths
from deformrf.core.training.data.foreign_paths import find_files, tried


def found(folder, *names):
    """Where the files are, from the folder on; None where there is none."""
    paths = find_files(folder, list(names), folder / "transforms.json").paths
    return [None if path is None else path.relative_to(folder).as_posix() for path in paths]


@pytest.mark.parametrize(
    "name",
    [
        "images/2.png", "images/2", "./images/2.png", "images//2.png", "images/./2.png",
        "images\\2.png", ".\\images\\2.png", "C:\\data\\toy\\images\\2.png", "d:/toy/images/2.png",
        "\\\\server\\share\\images\\2.png", "//server/share/images/2.png",
        "/home/x/data/images/2.jpeg", "/home/x/data/images/2", "/home/x/IMAGES/2.PNG",
        "file:///home/x/images/2.png", "file://localhost/C:/x/images/2.png", "FILE:///x/images/2",
        "../data/toy/images/2.png", "data/nerf/toy/images/2.jpg", "toy/../images/2.png",
        "images/2.tif", "images/2.BMP", "/home/x/rgb/2.png", "2.png", "/2.png",
    ],
)  # fmt: skip
def test_spellings_of_other_machines_mean_the_file_here(tmp_path, name):
    put(tmp_path / "images/2.png")
    assert found(tmp_path, name) == ["images/2.png"]


@pytest.mark.parametrize("ending", ["png", "PNG", "Jpg", "jpeg", "webp", "tif", "TIFF", "bmp"])
def test_an_ending_in_any_case_may_be_left_out_or_be_another(tmp_path, ending):
    put(tmp_path / "a.png").rename(tmp_path / f"a.{ending}")
    for name in ("a", f"a.{ending.lower()}", f"a.{ending.upper()}", "a.jpg", "./a.tif"):
        assert found(tmp_path, name) == [f"a.{ending}"]


def test_names_that_are_no_ascii(tmp_path):
    """macOS takes letters apart, and browsers write them as bytes."""
    name = "bücher/café 1%.png"
    put(tmp_path / unicodedata.normalize("NFC", name))
    spelled = [
        unicodedata.normalize("NFD", name),
        f"x/{unicodedata.normalize('NFD', name)}",
        "file:///x/b%C3%BCcher/caf%C3%A9%201%25.png",
        "/x/b%C3%BCcher/caf%C3%A9%201%25.png",
    ]
    for one in spelled:
        assert found(tmp_path, one) == [unicodedata.normalize("NFC", name)]


def test_the_longest_tail_wins_and_what_is_left_in_doubt_is_refused(tmp_path):
    for name in ("a/images/2.png", "b/images/2.png", "b/3.png", "b/3.webp", "c/4.png", "4.png"):
        put(tmp_path / name)
    assert found(tmp_path, "/x/b/images/2.png", "/x/a/images/2.jpg") == [
        "b/images/2.png",
        "a/images/2.png",
    ]
    for name, both in (
        ("/x/images/2.png", "a/images/2.png or b/images/2.png"),
        ("/x/b/3.jpg", "b/3.png or b/3.webp"),
    ):
        with pytest.raises(DatasetError, match=f"{name}, which may be {both} in") as caught:
            found(tmp_path, name)
        assert "\n" not in str(caught.value)
    assert found(tmp_path, "/x/b/3.WEBP") == ["b/3.webp"]
    assert found(tmp_path, "/x/4.png") == ["4.png"]  # as it lies from the folder on


def test_what_is_missing_is_not_found_in_another_split_or_among_masks(tmp_path):
    for name in ("test/1.png", "masks/1.png", "depth/1.png", "images/0.png", "train/0.png"):
        put(tmp_path / name)
    (tmp_path / ".thumbs").mkdir()
    put(tmp_path / ".thumbs/1.png")
    names = "train/1.png", "./train/1", "/x/train/1.png", "images/1.png", "/x/1.png", "val/1.png"
    assert found(tmp_path, *names) == [None] * 6
    assert found(tmp_path, "/x/masks/1.jpg", "/x/test/1.jpg") == ["masks/1.png", "test/1.png"]


def test_two_names_never_share_a_file_unless_both_are_its_own(tmp_path):
    put(tmp_path / "images/1.png")
    assert found(tmp_path, "images/1.png", "./images/1.png", "images\\1.png", "images/1")
    for names in (("/x/cam0/1.png", "/x/cam1/1.png"), ("images/1.png", "images/1.jpg")):
        with pytest.raises(DatasetError, match=r"for both only images/1\.png is in .*keep the"):
            found(tmp_path, *names)


@pytest.mark.parametrize("name", ["/x/other/7.png", "..\\other\\7.png", "/x/linked/7.png"])
def test_files_are_sought_within_the_folder_alone(tmp_path, name):
    """And what a link leads to is refused as ever, unless it is allowed."""
    put(tmp_path / "other/7.png")
    folder = tmp_path / "data"
    put(folder / "images/1.png")
    (folder / "linked").symlink_to(tmp_path / "other")
    frames = [
        {"file_path": one, "transform_matrix": pose.tolist()}
        for one, pose in zip(("images/1.png", name), circle(2), strict=True)
    ]
    write_frames(folder, frames, name="transforms_train.json", **PHONE)
    if "linked" in name:
        with pytest.raises(DatasetError, match="lies outside the data set's folder"):
            load_dataset(folder, "train")
        assert load_dataset(folder, "train", outside=True).view_count == 2
    else:
        assert load_dataset(folder, "train").missing == (name,)


def test_folders_that_link_in_circles_end(tmp_path):
    put(tmp_path / "a/images/1.png")
    (tmp_path / "a/images/up").symlink_to(tmp_path)
    assert found(tmp_path, "/x/a/images/1.png", "/x/up/1.png") == ["a/images/1.png", None]


def test_pipes_and_links_to_themselves_are_no_images(tmp_path):
    """A pipe would be waited for, and the way of such a link has no end."""
    (tmp_path / "images").mkdir()
    os.mkfifo(tmp_path / "images/1.png")
    (tmp_path / "images/2.png").symlink_to("2.png")
    assert found(tmp_path, "images/1.png", "/x/images/1.png", "/x/images/2.jpg") == [None] * 3


def test_a_real_data_set_of_another_machine_is_read_and_told_once(tmp_path, capsys):
    """Absolute paths with an ending that the files don't have; train and test are one set."""
    expected = transforms(tmp_path / "here", count=17, **PHONE)
    foreign = json.loads((expected / "transforms.json").read_text())
    for frame in foreign["frames"]:
        frame["file_path"] = f"/home/x/data/{frame['file_path'].replace('.png', '.jpeg')}"
    there = tmp_path / "there"
    write_frames(there, foreign["frames"], **PHONE)
    (expected / "images").rename(there / "images")
    running.say_once.cache_clear()
    sets = [running.load_views(there, split) for split in ("train", "test")]
    assert [one.view_count for one in sets] == [14, 3]
    assert [one.names for one in sets][1] == ("0000", "0008", "0016")
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "17 of 17 paths in transforms.json do not exist: files of" in told
    assert (
        "files of images are read instead, first images/0000.png for /home/x/data/images/0000.jpeg"
        in told
    )


def test_if_nothing_fits_it_says_what_was_tried(tmp_path):
    folder = transforms(tmp_path, **PHONE)
    for path in folder.glob("images/*"):
        path.unlink()
    with pytest.raises(NoImagesError, match="none of the 7 train images is there") as caught:
        load_dataset(folder, "train")
    assert "images/0001.png (tried as it is, and images/0001.png, 0001.png in" in str(caught.value)
    assert len(tried("x" * 10_000)) < 500 and "\n" not in str(caught.value)


def test_ten_thousand_names_look_at_a_folder_once(tmp_path, monkeypatch):
    (tmp_path / "images").mkdir()
    names = []
    for i in range(10_000):
        (tmp_path / f"images/{i}.png").touch()
        names.append(f"/home/someone/data/scene/images/{i}.jpeg")
    looked, look = [], foreign_paths._entries

    def count(place):
        looked.append(place)
        return look(place)

    monkeypatch.setattr(foreign_paths, "_entries", count)
    paths = find_files(tmp_path, names, tmp_path / "transforms.json").paths
    assert [path.stem for path in paths] == [Path(name).stem for name in names]
    assert len(looked) == 2


def test_in_a_folder_that_is_too_large_nothing_is_guessed(tmp_path, monkeypatch):
    monkeypatch.setattr(foreign_paths, "MOST_ENTRIES", 5)
    for i in range(4):
        put(tmp_path / f"images/{i}.png")
    assert found(tmp_path, "/x/images/1.png") == ["images/1.png"]
    put(tmp_path / "images/4.png")
    assert found(tmp_path, "/x/images/1.png", "images/2") == [None, "images/2.png"]


def test_any_name_is_a_file_within_the_folder_or_none(tmp_path):
    """Names of random parts: all files are found by their names, and nothing else ever is."""
    rng = np.random.default_rng()
    parts = ["a", "B", "images", "..", ".", "", "C:", "%", "%2e%2e", "\\", "é", "1", "2.png"]
    parts += ["1.JPG", "file:", "\0", "\ud800", "x" * 300, "test", "masks", "/"]
    for name in ("a/images/1.png", "B/2.png", "images/1.jpg", "test/1.png", "masks/é.tif"):
        put(tmp_path / name)
    counts = {"found": 0, "none": 0, "refused": 0}
    for _ in range(3000):
        chosen = [parts[i] for i in rng.integers(len(parts), size=rng.integers(1, 6))]
        name = "".join(part + rng.choice(["/", "\\", "/", ""]) for part in chosen)
        try:
            path = find_files(tmp_path, [name], tmp_path / "t.json").paths[0]
        except DatasetError as error:
            counts["refused"] += "may be" in str(error)
            continue
        counts["none" if path is None else "found"] += 1
        assert path is None or (path.is_file() and path.resolve().is_relative_to(tmp_path))
    assert min(counts["found"], counts["none"]) > 100 and sum(counts.values()) == 3000, counts


# -- lists of splits, and text of other machines -------------------------------------------------


@pytest.mark.parametrize(
    "spell", ["./images/{}.png", "images\\{}.png", "images/{}", "/home/x/images/{}.jpg"]
)
def test_lists_of_a_split_are_compared_as_paths(tmp_path, spell):
    names = [spell.format(f"{i:04d}") for i in range(9)]
    lists = {"train_filenames": names[:5], "test_filenames": names[5:]}
    transforms(tmp_path, **PHONE, **lists)
    assert load_dataset(tmp_path, "train").names == ("0000", "0001", "0002", "0003", "0004")
    test = load_dataset(tmp_path, "test")
    assert test.names == ("0005", "0006", "0007", "0008") and not test.said


def test_names_of_a_list_that_no_frame_has_are_told(tmp_path):
    lists = {"train_filenames": ["images/0001.png", "images/0077.png", "./images/0078.png"]}
    data = load_dataset(transforms(tmp_path, **PHONE, **lists), "train")
    assert data.names == ("0001",)
    assert data.said == (
        "2 of 3 train_filenames in transforms.json name no frame, first images/0077.png",
    )


@pytest.mark.parametrize("coding", ["utf-8-sig", "utf-16", "utf-16-le"])
def test_a_byte_order_mark_is_none_of_the_text(tmp_path, coding):
    path = transforms(tmp_path, **PHONE) / "transforms.json"
    mark = "\ufeff" if coding.endswith("le") else ""
    path.write_bytes((mark + path.read_text()).encode(coding))
    assert load_dataset(tmp_path, "train").view_count == 7


def test_frames_of_several_times_are_told_of(tmp_path):
    moving = transforms(tmp_path / "a", per_frame=lambda i: {"time": i / 8}, **PHONE)
    (sentence,) = load_dataset(moving, "train").said
    assert "show 9 different times, and one still object is trained of all of them" in sentence
    still = transforms(tmp_path / "b", per_frame=lambda i: {"time": 0.5}, **PHONE)
    assert load_dataset(still, "train").said == ()


def test_colmaps_names_follow_the_same_rule(tmp_path):
    folder = colmap(tmp_path)
    for path in (folder / "images").iterdir():
        path.rename(path.with_suffix(".PNG"))
    data = load_dataset(folder, "train")
    assert data.names == tuple(f"{i:04d}" for i in range(1, 8))
    assert "9 of 9 paths in sparse/0 do not exist: files of" in data.said[0]
