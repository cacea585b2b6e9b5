"""Names and folders of files that the program writes."""

import os
import shutil

import pytest

from deformrf.core.paths import free_name, whole_file, whole_files, working_folder


def test_a_name_is_free(tmp_path):
    assert free_name(tmp_path / "film.v2", ".jsonl") == tmp_path / "film.v2.jsonl"
    (tmp_path / "film.v2.jsonl").touch()
    (tmp_path / "film.v2-2.jsonl").symlink_to("nowhere")
    assert free_name(tmp_path / "film.v2", ".jsonl") == tmp_path / "film.v2-3.jsonl"


@pytest.mark.skipif(os.name != "posix", reason="a folder in use can't be deleted there")
def test_files_go_to_the_users_folder_if_the_current_one_is_gone(tmp_path, monkeypatch):
    from deformrf.viewer.films.film_job import FilmChoices
    from deformrf.viewer.films.recorder import stamped

    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    assert working_folder() == tmp_path / "gone"
    shutil.rmtree(tmp_path / "gone")
    assert stamped("model", ".npz").parent == tmp_path
    assert FilmChoices("film").path == tmp_path / "film.mp4"


def test_a_file_appears_whole_and_touches_nothing_else(tmp_path):
    """A name of our own: somebody else's model.npz.part stays as it is."""
    path, theirs = tmp_path / "model.npz", tmp_path / "model.npz.part"
    theirs.write_text("theirs")
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), whole_file(path) as partial:
        assert partial.suffix == ".npz"
        partial.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    with whole_file(path) as partial:
        partial.write_text("new")
    assert (path.read_text(), theirs.read_text()) == ("new", "theirs")
    assert sorted(tmp_path.iterdir()) == [path, theirs]


def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    order, fsync, replace = [], os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda number: (order.append("fsync"), fsync(number)))
    monkeypatch.setattr(os, "replace", lambda *paths: (order.append("replace"), replace(*paths)))
    with whole_file(tmp_path / "a") as partial:
        partial.write_text("new")
    assert order[:2] == ["fsync", "replace"]


def test_of_several_files_all_are_written_or_none(tmp_path):
    old, new = tmp_path / "a", tmp_path / "b"
    old.write_text("old")
    new.mkdir()
    with pytest.raises(IsADirectoryError) as caught, whole_files([old, new]) as partials:
        for partial in partials:
            partial.write_text("new")
    assert caught.value.filename == str(new)
    assert old.read_text() == "old"
    assert sorted(tmp_path.iterdir()) == [old, new]
