"""Screenshots and clips of whatever the canvas shows."""

import numpy as np
import pytest
from PIL import Image

from deformrf.viewer.capture import Capture
from deformrf.viewer.status import Status


class Canvas:
    """Shows one gray."""

    size = 32, 24
    gray = 90

    def read(self):
        return np.full((24, 32, 3), self.gray, np.uint8)


@pytest.fixture
def capture(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Capture(Canvas(), Status(), lambda event, **fields: None)


def test_a_screenshot_is_of_the_next_frame_and_only_that(capture, tmp_path, capsys):
    capture.save_screenshot()
    assert list(tmp_path.iterdir()) == []
    capture.screenshot()
    capture.save_screenshot()
    capture.save_screenshot()
    (path,) = tmp_path.iterdir()
    assert np.asarray(Image.open(path)).mean() == 90
    assert path.name in capsys.readouterr().out
    assert capture.written[0].name == path.name


def test_a_clip_that_cannot_be_written_is_reported_and_the_rest_goes_on(capture, tmp_path, capsys):
    capture.start(30, tmp_path / "missing" / "a.mp4", live=False)
    for _ in range(3):
        capture.view_drawn()
    capture.stop()
    assert capture.failed
    said = capsys.readouterr().err
    assert said == f"can't write {tmp_path / 'missing' / 'a.mp4'}: No such file or directory\n"
    assert capture.written == []


def test_a_screenshot_that_cannot_be_written_is_reported(capture, tmp_path, capsys):
    capture.screenshot(tmp_path / "missing" / "a.png")
    capture.save_screenshot()
    assert capture.failed
    said = capsys.readouterr().err
    assert said == f"can't write {tmp_path / 'missing' / 'a.png'}: No such file or directory\n"


def test_stopping_without_a_clip_does_nothing(capture):
    capture.stop()
    assert not capture.failed
