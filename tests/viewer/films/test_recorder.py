"""Screenshots and videos of whatever the canvas shows, and the PNG files."""

import shutil
from dataclasses import replace
from fnmatch import fnmatch

import numpy as np
import pytest
from PIL import Image

from deformrf.core.base.paths import ROOT
from deformrf.core.field import load
from deformrf.viewer.films import recorder as r


class Canvas:
    """Shows one gray."""

    size = 32, 24
    gray = 90

    def read(self):
        return np.full((24, 32, 3), self.gray, np.uint8)


@pytest.fixture
def recorder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return r.Recorder(Canvas(), lambda event, **fields: None, fps=30)


def test_a_screenshot_is_of_the_next_frame_and_only_that(recorder, tmp_path, capsys):
    recorder.save_screenshot()
    assert list(tmp_path.iterdir()) == []
    recorder.screenshot()
    recorder.save_screenshot()
    recorder.save_screenshot()
    (path,) = tmp_path.iterdir()
    assert np.asarray(Image.open(path)).mean() == 90
    assert path.name in capsys.readouterr().out
    assert recorder.written[0].name == path.name


@pytest.mark.parametrize("bits, wanted", [(8, 8), (16, 16), (None, 8)])
def test_a_saved_model_has_the_bits_of_the_file_it_was_read_from(recorder, ball, bits, wanted):
    recorder.save_model(replace(ball, entry_bits=bits))
    assert load(recorder.written[0]).entry_bits == wanted


def test_a_clip_that_cannot_be_written_is_reported_and_the_rest_goes_on(recorder, tmp_path, capsys):
    recorder.start(tmp_path / "missing" / "a.mp4", live=False)
    for _ in range(3):
        recorder.add_frame()
    recorder.stop()
    assert recorder.failed
    said = capsys.readouterr().err
    assert said == f"can't write {tmp_path / 'missing' / 'a.mp4'}: No such file or directory\n"
    assert recorder.written == []


def test_a_screenshot_that_cannot_be_written_is_reported(recorder, tmp_path, capsys):
    recorder.screenshot(tmp_path / "missing" / "a.png")
    recorder.save_screenshot()
    assert recorder.failed
    said = capsys.readouterr().err
    assert said == f"can't write {tmp_path / 'missing' / 'a.png'}: No such file or directory\n"


def test_an_interrupt_while_it_stops_loses_no_video(recorder, tmp_path, monkeypatch):
    recorder.start(tmp_path / "a.mp4", live=False)
    recorder.add_frame()
    real = r.VideoWriter.close

    def interrupted(video, cut_short):
        real(video, cut_short)
        monkeypatch.setattr(r.VideoWriter, "close", real)
        raise KeyboardInterrupt

    monkeypatch.setattr(r.VideoWriter, "close", interrupted)
    with pytest.raises(KeyboardInterrupt):
        recorder.stop()
    recorder.stop(cut_short=True)  # as every end does
    assert recorder.written == [tmp_path / "a.mp4"] == list(tmp_path.iterdir())
    assert recorder.video is None and not recorder.failed


def test_stopping_without_a_clip_does_nothing(recorder):
    recorder.stop()
    assert not recorder.failed


@pytest.mark.parametrize("error", [OSError("the disk is full"), KeyboardInterrupt()])
@pytest.mark.parametrize("step", ["save", "replace"])
def test_a_picture_that_fails_leaves_no_file(tmp_path, monkeypatch, error, step):
    def save(picture, path, *_, **__):
        path.write_bytes(b"half a picture")
        fail()

    def fail(*paths):
        raise error

    if step == "save":
        monkeypatch.setattr("PIL.Image.Image.save", save)
    else:
        monkeypatch.setattr("os.replace", fail)
    with pytest.raises(type(error)):
        r.save_png(tmp_path / "a.png", np.full((48, 64, 3), 3, np.uint8))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.png.part", "a.part.mp4", ".model-0123abcd.part.npz"])
def test_git_ignores_unfinished_files(name):
    patterns = (ROOT / ".gitignore").read_text().split()
    assert any(fnmatch(name, pattern) for pattern in patterns)


def test_a_stamped_name_is_never_taken(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(r.time, "strftime", lambda _: "now")
    first = r.stamped("shot", ".png")
    r.save_png(first, np.full((48, 64, 3), 3, np.uint8))
    assert first.name == "shot-now.png"
    assert r.stamped("shot", ".png").name == "shot-now-2.png"


def test_a_background_is_taken_out_of_a_picture():
    rng = np.random.default_rng()
    color, alpha = rng.uniform(size=(40, 50, 3)), rng.integers(0, 256, (40, 50, 1)) / 255
    background = rng.uniform(size=3)
    over = np.concatenate([alpha * color + (1 - alpha) * background, alpha], axis=-1)
    straight = r.without_background(np.round(255 * over).astype(np.uint8), background)
    assert np.array_equal(straight[..., 3:], np.round(255 * alpha))
    error = abs(straight[..., :3] - 255 * color) * alpha  # as it shows over any color
    assert error.max() <= 1.01
    assert (straight[alpha[..., 0] == 0, :3] == 0).all()


def test_a_recording_without_a_frame_is_a_sentence(recorder, tmp_path, capsys):
    """Shift+F9 twice between two frames."""
    recorder.start_or_stop()
    recorder.start_or_stop()
    assert recorder.video is None
    assert recorder.message
    assert not list(tmp_path.glob("*.part*"))


def test_a_folder_that_is_deleted_while_recording_is_a_sentence(recorder, tmp_path, monkeypatch):
    folder = tmp_path / "gone"
    folder.mkdir()
    recorder.start(folder / "a.mp4")
    recorder.add_frame()
    shutil.rmtree(folder)
    recorder.stop()
    assert recorder.failed and "can't write" in recorder.message
    monkeypatch.setattr(r, "working_folder", lambda: folder)
    recorder.start_or_stop()
    recorder.add_frame()
    recorder.start_or_stop()
    assert recorder.video is None and "can't" in recorder.message
