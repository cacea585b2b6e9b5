"""Photographs as files: sizes, EXIF, HEIC, and what of them is decoded."""

import json
import sys

import numpy as np
import pytest
from PIL import Image

from deformrf.core.training import load_dataset, shrunk_size
from deformrf.wings import capture
from deformrf.wings.capture import CaptureError, find_cameras, library

pytest.importorskip("pycolmap")


def test_focal_length_and_device_come_from_exif(tmp_path):
    for name, length in (("a", 26), ("b", 26), ("c", 52)):
        exif = Image.Exif()
        exif[0x0110] = "Phone 3"
        exif.get_ifd(0x8769)[0xA405] = length
        Image.new("RGB", (400, 300)).save(tmp_path / f"{name}.jpg", exif=exif)
    Image.new("L", (400, 300)).save(tmp_path / "a_mask.png")
    (one, other, tele), unreadable = capture.photos.find_photos(tmp_path)
    assert not unreadable, "masks are no photographs"
    assert one.device == other.device != tele.device
    assert one.focal == pytest.approx(26 / 43.27 * 500, rel=1e-3) and tele.focal == 2 * one.focal


def test_heic_without_its_plugin_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    for number in range(9):
        (tmp_path / f"{number}.HEIC").write_bytes(b"\0\0\0\x18ftypheic")
    with pytest.raises(CaptureError, match=r"0\.HEIC is a HEIC image, .* pip install pillow-heif"):
        find_cameras(tmp_path, tmp_path / "work")


def test_a_large_photograph_is_decoded_small_and_upright(tmp_path):
    """JPEG's decoder halves it first; EXIF turns it."""
    ramp = np.linspace(0, 255, 1200).astype(np.uint8)
    pixels = np.stack([np.tile(ramp, (900, 1)), np.tile(ramp[:900, None], (1, 1200))] * 2, axis=-1)
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(pixels[..., :3]).save(tmp_path / "a.jpg", quality=95, exif=exif)
    ((photo,), _) = capture.photos.find_photos(tmp_path)
    assert photo.size == (900, 1200) and photo.is_turned
    small = capture.read_photo(photo, 400)
    assert small.shape == (400, 300, 3)
    upright = Image.fromarray(pixels[..., :3]).transpose(Image.Transpose.ROTATE_270)
    expected = np.asarray(upright.resize((300, 400), Image.Resampling.BOX)).astype(int)
    assert np.abs(small - expected).max() < 6


def test_photographs_of_twelve_megapixels_are_worked_at_another_size(tmp_path, monkeypatch):
    """Files of 4000x3000 pixels: nothing larger than the work size reaches the library."""
    image = Image.effect_noise((500, 375), 90).resize((4000, 3000)).convert("RGB")
    for number in range(8):
        image.save(tmp_path / f"{number}.jpg", quality=60)
    ((photo, *_), _) = capture.photos.find_photos(tmp_path)
    assert photo.size == (4000, 3000)
    assert shrunk_size(photo.size, capture.IMAGE_SIZE) == (1600, 1200)
    assert capture.read_photo(photo, capture.IMAGE_SIZE).shape == (1200, 1600, 3)
    sizes = []
    pycolmap = library.load_pycolmap()

    def looked_at(_, folder, names, **named):
        sizes.extend(Image.open(f"{folder}/{name}").size for name in names)
        raise KeyboardInterrupt

    monkeypatch.setattr(pycolmap, "extract_features", looked_at)
    with pytest.raises(KeyboardInterrupt):
        find_cameras(tmp_path, tmp_path / "work")
    assert sizes and set(sizes) == {(1600, 1200)}


def test_heic_photographs_are_read(tmp_path):
    """A HEIC file holds its rotation itself; the EXIF orientation doesn't count."""
    pillow_heif = pytest.importorskip("pillow_heif", reason="no pillow-heif: HEIC is not tried")
    pillow_heif.register_heif_opener()
    ramp = np.tile(np.linspace(0, 255, 240).astype(np.uint8), (160, 1))
    image = Image.fromarray(np.stack([ramp, 255 - ramp, 0 * ramp], axis=-1))
    exif = Image.Exif()
    exif[0x0110] = "Phone 3"
    image.save(tmp_path / "b.jpg", quality=95, exif=exif)
    exif[0x0112] = 6
    image.save(tmp_path / "a.heic", quality=95, exif=exif)
    (heic, jpeg), unreadable = capture.photos.find_photos(tmp_path)
    assert not unreadable and heic.size == jpeg.size == (240, 160) and not heic.is_turned
    assert heic.device == jpeg.device
    seen = [capture.read_photo(photo, 400).astype(int) for photo in (heic, jpeg)]
    assert np.abs(seen[0] - seen[1]).mean() < 8
    pose = {"transform_matrix": np.eye(4).tolist()}
    frames = [{"file_path": photo.path.name, **pose} for photo in (heic, jpeg)]
    scene = {"w": 240, "h": 160, "fl_x": 200.0, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(scene))
    views = [load_dataset(tmp_path, split).image(0).astype(int) for split in ("train", "test")]
    assert np.abs(views[0] - views[1]).mean() < 8
