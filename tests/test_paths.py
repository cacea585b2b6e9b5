"""Names and folders of files that the program writes."""

import os
import shutil

import pytest

from deformrf.core.paths import free_name, working_folder


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
