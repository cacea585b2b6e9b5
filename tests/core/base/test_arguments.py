"""What command lines accept."""

import os

import pytest

from deformrf.core.base import arguments
from deformrf.core.base.paths import WriteError


def test_the_error_names_a_number_that_is_too_small():
    arguments.at_least(2, "--steps", 2)
    arguments.at_least(2, "--steps", None)
    with pytest.raises(ValueError, match="--steps is 1: it has to be at least 2"):
        arguments.at_least(2, "--steps", 1)


def test_checking_for_a_writable_file_neither_makes_nor_changes_it(tmp_path):
    new, old = tmp_path / "folder" / "new.png", tmp_path / "old.png"
    old.write_text("kept")
    assert arguments.writable_file(new, ".png") == new
    assert arguments.writable_file(old, ".png") == old
    assert not new.exists()
    assert old.read_text() == "kept"


def test_an_interrupt_while_it_is_checked_leaves_nothing(tmp_path, monkeypatch):
    real = os.unlink

    def interrupted(path):
        monkeypatch.setattr(os, "unlink", real)
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "unlink", interrupted)
    with pytest.raises(KeyboardInterrupt):
        arguments.writable_file(tmp_path / "a.npz", ".npz")
    assert list(tmp_path.iterdir()) == []


def test_what_is_read_is_not_written_over(tmp_path):
    path, link = tmp_path / "rig.npz", tmp_path / "link.npz"
    path.write_text("a rig")
    link.symlink_to(path)
    for output in (path, link, tmp_path / "." / "rig.npz"):
        with pytest.raises(ValueError, match="is read, and would be lost"):
            arguments.writable_file(output, ".npz", source=path)
    assert arguments.writable_file(tmp_path / "b.npz", ".npz", source=path) == tmp_path / "b.npz"
    assert path.read_text() == "a rig"


def test_another_ending_and_a_folder_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"has to end in \.png"):
        arguments.writable_file(tmp_path / "a.jpg", ".png")
    (tmp_path / "a.png").mkdir()
    with pytest.raises(WriteError, match=r"can't write .*a\.png: it is a folder, not a file"):
        arguments.writable_file(tmp_path / "a.png", ".png")


def test_a_link_to_a_file_that_is_not_there_stays(tmp_path):
    link = tmp_path / "a.png"
    link.symlink_to("b.png")
    assert arguments.writable_file(link, ".png") == link
    assert link.is_symlink() and not (tmp_path / "b.png").exists()
