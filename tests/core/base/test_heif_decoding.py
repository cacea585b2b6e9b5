"""Pixels of HEIF files, decoded by a process that may crash, hang or lie."""

import os
import time
from pathlib import Path

import numpy as np
import pytest
from heif_files import coded, heic
from PIL import Image

from deformrf.core.base import heif_decoding
from deformrf.core.base.heif import HeifError, read_heif
from deformrf.core.base.images import MOST_PIXELS

TRUE = 3.0  # mean difference of what x265 keeps, from what it was given


def picture(width, height):
    """Smooth noise, which HEVC keeps; each place has a color of its own.  [h, w, 3] uint8"""
    noise = np.random.default_rng().integers(40, 216, (5, 7, 3), np.uint8)
    return np.asarray(Image.fromarray(noise).resize((width, height), Image.Resampling.BILINEAR))


def decoded(path):
    heif = read_heif(path, MOST_PIXELS)
    pixels = np.frombuffer(heif_decoding.decode(path, heif), np.uint8)
    return pixels.reshape(*heif.stored[::-1], 3)


def written(tmp_path, *arguments, **named):
    path = tmp_path / "a.heic"
    path.write_bytes(heic(*arguments, **named))
    return path


def difference(pixels, expected):
    assert pixels.shape == expected.shape
    return np.abs(pixels.astype(int) - expected).mean()


@pytest.mark.parametrize("depth", [8, 10])
@pytest.mark.parametrize("side, width, height", [(None, 150, 130), (64, 151, 131), (64, 64, 190)])
def test_pixels_come_back(tmp_path, side, width, height, depth):
    """One picture, grids of three by three and of one column; odd sizes are cut off tiles."""
    pixels = picture(width, height)
    found = decoded(written(tmp_path, pixels, side, depth=depth))
    assert difference(found, pixels) < TRUE
    mean = (found.astype(int) - pixels).mean(axis=(0, 1))
    assert np.abs(mean).max() < 1.0, "no color is darker or brighter"


def test_tiles_lie_row_by_row(tmp_path):
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9], [90, 90, 90], [250] * 3])
    pixels = colors.astype(np.uint8).reshape(2, 3, 3).repeat(64, axis=0).repeat(64, axis=1)
    found = decoded(written(tmp_path, pixels, 64))
    assert np.abs(found[32::64, 32::64].reshape(6, 3).astype(int) - colors).max() < 8


@pytest.mark.parametrize("side", [None, 64])
@pytest.mark.parametrize("depth", [8, 10])
@pytest.mark.parametrize("span", ["full", "limited"])
def test_the_range_is_that_of_the_file(tmp_path, span, depth, side):
    """The full one if HEIF's box or HEVC itself says so."""
    pixels = np.full((64, 128, 3), 128, np.uint8)
    pixels[:, :64] = 60
    stretched = (pixels - 16.0) * 255 / 219
    for colors, expected in (
        ((1, 13, 6, 0x80), pixels),
        ((1, 13, 6, 0), pixels if span == "full" else stretched),
        (None, pixels if span == "full" else stretched),
    ):
        found = decoded(written(tmp_path, pixels, side, colors=colors, depth=depth, span=span))
        assert difference(found, expected) < TRUE


@pytest.mark.parametrize("transfer", [16, 18])
def test_hdr_is_refused(tmp_path, transfer):
    path = written(tmp_path, picture(64, 64), colors=(9, transfer, 9, 0x80))
    with pytest.raises(HeifError, match="it is in HDR") as error:
        decoded(path)
    assert "HDR switched off" in error.value.advice


def test_hevc_that_is_larger_than_declared_is_refused(tmp_path):
    """Before its memory is taken: the coded size alone says so."""
    path = written(tmp_path, picture(640, 480), size=(64, 64))
    with pytest.raises(HeifError, match="damaged"):
        decoded(path)
    with pytest.raises(HeifError, match="damaged"):  # nor smaller
        decoded(written(tmp_path, picture(64, 64), size=(128, 64)))


def test_damage_in_the_coded_bytes_is_seen(tmp_path):
    """What is no HEVC; damage further on may pass, as in a JPEG."""
    pixels = np.random.default_rng().integers(0, 256, (256, 256, 3), np.uint8)
    data = heic(pixels)
    _, unit = coded(pixels)
    begin = data.index(unit)
    path = tmp_path / "a.heic"
    for first, last in ((0, 4), (4, 20), (0, len(unit))):
        path.write_bytes(data[: begin + first] + bytes(last - first) + data[begin + last :])
        with pytest.raises(HeifError, match="damaged"):
            decoded(path)


@pytest.mark.parametrize(
    "code, words",
    [
        ("import os; os.abort()", "damaged"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "damaged"),
        ("import sys; sys.stdout.buffer.write(bytes(100))", "damaged"),
        ("import sys; sys.stdout.buffer.write(bytes(3 * 64 * 64 + 1))", "damaged"),
        ("import sys; sys.stdin.buffer.read(); bytearray(10**15)", "damaged"),
        ("import sys; sys.exit(4)", "no decoder of HEVC"),
        ("import time; time.sleep(60)", "not be decoded within 1 s"),
    ],
)
def test_a_decoder_that_fails_ends_in_a_sentence(tmp_path, monkeypatch, code, words):
    path = written(tmp_path, picture(64, 64))
    monkeypatch.setattr(heif_decoding, "CHILD", code)
    monkeypatch.setattr(heif_decoding, "SECONDS", 1 if "sleep" in code else 60)
    began = time.monotonic()
    with pytest.raises(HeifError, match=words):
        decoded(path)
    assert time.monotonic() - began < 30


def test_the_decoder_has_bounded_memory(tmp_path, monkeypatch):
    pytest.importorskip("resource")
    path = written(tmp_path, picture(64, 64))
    taken = "\nheif_decoding.decoded = lambda *_: bytearray(5 * 2**30)\n"
    begun = f"from {heif_decoding.__package__} import heif_decoding{taken}heif_decoding.main()"
    monkeypatch.setattr(heif_decoding, "CHILD", begun)
    with pytest.raises(HeifError, match="damaged"):
        decoded(path)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="no /proc: open files aren't listed")
def test_no_process_and_no_pipe_is_left(tmp_path):
    path = written(tmp_path, picture(64, 64))
    decoded(path)
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        decoded(path)
    assert len(os.listdir("/proc/self/fd")) == before
