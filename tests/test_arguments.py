"""What command lines accept."""

import pytest

from deformrf.core import arguments


def test_a_number_that_is_too_small_is_called_by_its_name():
    assert arguments.at_least(2, "--steps", 2) == 2
    with pytest.raises(ValueError, match="--steps is 1: it has to be at least 2"):
        arguments.at_least(2, "--steps", 1)


def test_a_file_that_can_be_written_is_not_made_and_not_changed(tmp_path):
    new, old = tmp_path / "folder" / "new.png", tmp_path / "old.png"
    old.write_text("kept")
    assert arguments.writable_file(new, ".png") == new
    assert arguments.writable_file(old, ".png") == old
    assert not new.exists()
    assert old.read_text() == "kept"


def test_what_is_no_file_of_that_kind_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"has to end in \.png"):
        arguments.writable_file(tmp_path / "a.jpg", ".png")
    (tmp_path / "a.png").mkdir()
    with pytest.raises(ValueError, match="is a folder"):
        arguments.writable_file(tmp_path / "a.png", ".png")
