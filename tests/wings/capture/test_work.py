"""The folder for unfinished work: what is not ours in it, or in its place, is never touched."""

import json
import os
import sqlite3
from contextlib import closing

import numpy as np
import pytest
from PIL import Image

from deformrf.commands import capturing
from deformrf.wings.capture import cameras, find_photos
from deformrf.wings.capture.work import LARGEST, Look, open_work


@pytest.fixture
def photos(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for number in range(3):
        Image.new("RGB", (32, 24), (40 * number, 90, 60)).save(folder / f"{number}.jpg")
    return find_photos(folder)[0]


@pytest.fixture
def place(tmp_path):
    return tmp_path / "toy.capture"


def everything(folder):
    """Paths below a folder, with what files hold and links lead to."""
    return {p.relative_to(folder).as_posix(): contents(p) for p in sorted(folder.rglob("*"))}


def contents(path):
    if path.is_symlink():
        return os.readlink(path)
    return path.read_bytes() if path.is_file() else "folder"


def make_ours(place, photos):
    """Work on other photographs, of which a run was killed while it mapped."""
    work, _ = open_work(place, photos[:2], 100)
    for name in ("features.db", "features.db-journal", "pairs.txt", "000000.npz", "1000000.npz"):
        (place / name).write_bytes(b"ours")
    (place / ".000001-0123abcd.part.npz").write_bytes(b"half")
    group = place / ".temporary-abc_1234" / "0"
    group.mkdir(parents=True)
    (group / "images.bin").write_bytes(b"ours")
    (group.parent / "000001.png").write_bytes(b"ours")
    return work


def strangers(place, listing):
    place.mkdir()
    if listing is not None:
        (place / "work.json").write_text(listing)
    (place / "thesis.txt").write_text("years of work")


@pytest.mark.parametrize(
    "listing",
    [
        None,
        "",
        '{"hours": 12}',
        '{"version": 2, "photos": []}',
        '{"version": true}',
        '{"version": 1}',
        '{"version": 1, "hours": 12, "image_size": 5, "photos": []}',
        '{"version": 1',
        "[" * 100_000,
        "[]",
        "\x00" * 100,
        " " * LARGEST + '{"version": 1}',
    ],
    ids=[
        "none",
        "empty",
        "other",
        "newer",
        "true",
        "alone",
        "more",
        "cut",
        "deep",
        "list",
        "binary",
        "huge",
    ],
)
def test_what_is_not_ours_is_left(place, photos, listing):
    strangers(place, listing)
    (place / "features.db").write_text("a name that we use, too")
    before = everything(place)
    work, again = open_work(place, photos, 1600)
    assert (work.folder, again) == (place.with_name("toy.capture-2"), False)
    assert everything(place) == before
    assert open_work(place, photos, 1600) == (work, True), "the next run goes on there"
    assert work.remove() and not work.folder.exists() and everything(place) == before


def test_work_on_other_photographs_is_removed_file_by_file(place, photos):
    make_ours(place, photos)
    work, again = open_work(place, photos, 1600)
    assert (work.folder, again) == (place, False)
    assert [path.name for path in place.iterdir()] == ["work.json"]


def test_what_lies_among_ours_is_kept(place, photos):
    make_ours(place, photos)
    (place / "thesis.txt").write_text("years of work")
    (place / ".temporary-abc_1234" / "0" / "notes.md").write_text("mine")
    (place / ".temporary-notes").mkdir()
    work, _ = open_work(place, photos, 1600)
    assert work.folder == place.with_name("toy.capture-2")
    assert everything(place) == {
        "thesis.txt": b"years of work",
        ".temporary-abc_1234": "folder",
        ".temporary-abc_1234/0": "folder",
        ".temporary-abc_1234/0/notes.md": b"mine",
        ".temporary-notes": "folder",
    }


def test_work_that_ends_leaves_what_was_put_beside_it(place, photos):
    work, _ = open_work(place, photos, 1600)
    (place / "thesis.txt").write_text("years of work")
    assert open_work(place, photos, 1600) == (work, True), "that is no hindrance"
    assert not work.remove()
    assert everything(place) == {"thesis.txt": b"years of work"}


def test_a_name_of_ours_that_is_a_link_or_a_folder_makes_it_another_s(place, photos, tmp_path):
    (tmp_path / "mine.db").write_text("precious")
    for name, make in (
        ("features.db", lambda path: path.symlink_to(tmp_path / "mine.db")),
        ("000000.npz", lambda path: path.mkdir()),
    ):
        work, _ = open_work(place, photos, 1600)
        make(place / name)
        before = everything(tmp_path)
        other, again = open_work(place, photos, 1600)
        assert other.folder == place.with_name("toy.capture-2") and not again
        assert other.remove() and everything(tmp_path) == before
        (place / name).rmdir() if (place / name).is_dir() else (place / name).unlink()
        assert work.remove()


def test_a_link_a_file_and_a_pipe_in_its_place_are_left(place, photos, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    make_ours(tmp_path / "elsewhere" / "toy.capture", photos)
    before = everything(tmp_path / "elsewhere")
    place.symlink_to(tmp_path / "elsewhere" / "toy.capture")
    place.with_name("toy.capture-2").write_text("a file")
    place.with_name("toy.capture-3").symlink_to("nowhere")
    if hasattr(os, "mkfifo"):
        os.mkfifo(place.with_name("toy.capture-4"))
    else:
        place.with_name("toy.capture-4").write_text("")
    work, _ = open_work(place, photos, 1600)
    assert work.folder == place.with_name("toy.capture-5")
    assert everything(tmp_path / "elsewhere") == before and place.is_symlink()


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"text" * 500])
def test_damaged_work_is_done_again(place, photos, damage):
    work, _ = open_work(place, photos, 1600)
    with closing(sqlite3.connect(work.database_path)) as database:
        database.execute("CREATE TABLE features (x)")
        database.executemany("INSERT INTO features VALUES (?)", [("x" * 99,)] * 999)
        database.commit()
    assert open_work(place, photos, 1600) == (work, True)
    work.keep_look(0, Look(np.zeros((3, 3), np.uint8), 0.5, 0.25))
    assert work.has_look(0) and work.look(0).exposure == 0.25 and not work.has_look(1)
    work.look_path(0).write_bytes(damage(work.look_path(0).read_bytes()))
    assert not work.has_look(0)
    work.database_path.write_bytes(damage(work.database_path.read_bytes()))
    assert open_work(place, photos, 1600) == (work, False)
    assert [path.name for path in place.iterdir()] == ["work.json"]


def test_a_folder_that_a_run_was_killed_in_at_its_beginning_is_used(place, photos):
    place.mkdir()
    (place / ".work-0123abcd.part.json").write_text("{")
    assert open_work(place, photos, 1600)[0].folder == place
    assert [path.name for path in place.iterdir()] == ["work.json"]


def test_work_whose_cameras_were_found_is_removed_by_the_next_run(place, photos, tmp_path):
    """A kill between the cameras and the end of their work leaves it."""
    open_work(place, photos, 1600)
    (tmp_path / "others").mkdir()
    for folder in ("others", "photos"):
        (tmp_path / folder / "transforms.json").write_text('{"frames": []}')
        capturing.prepared(tmp_path / folder, place.with_suffix(".npz"), 64)
        assert place.exists() == (folder == "others"), "work on other photographs stays"
    strangers(place, '{"version": 1, "image_size": 5, "photos": [7]}')
    capturing.prepared(tmp_path / "photos", place.with_suffix(".npz"), 64)
    assert (place / "thesis.txt").exists()


def test_an_empty_folder_is_used(place, photos):
    place.mkdir()
    assert open_work(place, photos, 1600)[0].folder == place


def test_a_listing_that_is_a_pipe_is_not_waited_for(place, photos):
    place.mkdir()
    os.mkfifo(place / "work.json")
    assert open_work(place, photos, 1600)[0].folder == place.with_name("toy.capture-2")


def test_the_command_says_where_the_work_is(place, photos, capsys, monkeypatch):
    strangers(place, json.dumps({"hours": 12}))
    monkeypatch.setattr(cameras, "find_features", interrupted)
    monkeypatch.setattr(cameras, "LEAST_PHOTOS", 3)
    with pytest.raises(KeyboardInterrupt):
        capturing.found_by(photos[0].path.parent, place, 200, False)
    said = capsys.readouterr()
    other = f"{place}-2"
    assert f"unfinished work is kept in {other} ({place} holds something else" in said.out
    assert f"What was found so far is in {other}: the same command goes on there" in said.err
    with pytest.raises(KeyboardInterrupt):
        capturing.found_by(photos[0].path.parent, place, 200, False)
    assert f"going on with the work in {other}" in capsys.readouterr().out
    assert everything(place)["thesis.txt"] == b"years of work"


def interrupted(*_):
    raise KeyboardInterrupt
