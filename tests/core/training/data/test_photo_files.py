"""Which files of a folder are photographs; what is said of a camera's raw files."""

import pytest

from deformrf.core.training import DatasetError, about_raw_files, photo_files, photo_folder


def touch(folder, *names):
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).touch()


def test_photographs_are_known_by_their_endings_and_masks_are_none(tmp_path):
    touch(tmp_path, "b.HEIC", "a.jpg", "a_mask.png", "c.hif", "d.txt", ".e.jpg", "f.dng")
    assert [path.name for path in photo_files(tmp_path)] == ["a.jpg", "b.HEIC", "c.hif"]


@pytest.mark.parametrize("inner", ["", "dcim"])
def test_a_folder_of_raw_files_alone_is_refused(tmp_path, inner):
    touch(tmp_path / inner, "b.CR3", "a.dng")
    with pytest.raises(
        DatasetError, match=r"^2 raw files .*, first a\.dng, .* export JPEG or TIFF"
    ):
        photo_folder(tmp_path)


def test_raw_files_beside_photographs_are_named(tmp_path):
    """Not those that a camera has written beside their JPEG."""
    touch(tmp_path, "a.jpg", "a.NEF", ".b.nef")
    assert photo_folder(tmp_path) == tmp_path and about_raw_files(tmp_path) == ""
    touch(tmp_path, "c.NEF")
    assert photo_folder(tmp_path) == tmp_path
    assert about_raw_files(tmp_path).startswith(
        f"1 raw file of a camera in {tmp_path}, first c.NEF"
    )


def test_a_folder_of_neither_is_none(tmp_path):
    touch(tmp_path, "a.txt")
    assert photo_folder(tmp_path) is None


@pytest.mark.parametrize("name", ["masks", "Mask", "masks-2"])
def test_a_folder_of_masks_holds_no_photographs(tmp_path, name):
    touch(tmp_path / "pictures", "a.png")
    touch(tmp_path / name, "a.png")
    assert photo_folder(tmp_path) == tmp_path / "pictures"
