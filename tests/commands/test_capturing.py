"""Photographs without cameras, as a command's data."""

import pytest
from PIL import Image

from deformrf.commands import capturing
from deformrf.core.training import DatasetError
from deformrf.wings import capture


def test_raw_files_beside_photographs_are_named_before_the_work(tmp_path, monkeypatch, capsys):
    Image.new("RGB", (32, 24)).save(tmp_path / "a.jpg")
    (tmp_path / "b.CR2").touch()

    def stop(*_, device):
        assert device == "cpu"
        raise KeyboardInterrupt

    monkeypatch.setattr(capture, "find_cameras", stop)
    with pytest.raises(KeyboardInterrupt):
        capturing.found_by(tmp_path, tmp_path / "work", 400, False, device="cpu")
    said = f"1 raw file of a camera in {tmp_path}, first b.CR2, can't be read: export JPEG or TIFF"
    assert capsys.readouterr().out == f"{said} files.\n"


def test_raw_files_alone_are_one_sentence(tmp_path):
    (tmp_path / "b.CR2").touch()
    with pytest.raises(DatasetError, match=r"1 raw file .*b\.CR2"):
        capturing.needs_cameras(tmp_path)
