"""Photographs as files: sizes, EXIF, HEIC, and what of them is decoded."""

import json

import numpy as np
import pytest
from heif_files import ROTATE, heic
from PIL import Image

from deformrf.core.base import heif_decoding, images
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


def test_heic_without_pyav_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(images, "is_possible", lambda: False)
    for number in range(9):
        (tmp_path / f"{number}.HEIC").write_bytes(b"\0\0\0\x18ftypheic" + bytes(12))
    with pytest.raises(CaptureError, match=r"0\.HEIC is a HEIC image, .*: pip install av, or"):
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


@pytest.mark.parametrize("side", [None, 64])
def test_heic_photographs_are_read(tmp_path, side):
    """A HEIC file holds its rotation itself; the EXIF orientation doesn't count."""
    ramp = np.tile(np.linspace(0, 255, 160).astype(np.uint8), (240, 1))
    pixels = np.stack([ramp, 255 - ramp, 0 * ramp], axis=-1)
    exif = Image.Exif()
    exif[0x0110] = "Phone 3"
    exif.get_ifd(0x8769)[0xA405] = 26
    upright = Image.fromarray(pixels).transpose(Image.Transpose.ROTATE_90)
    upright.save(tmp_path / "b.jpg", quality=95, exif=exif)
    exif[0x0112] = 8
    turned = heic(pixels, side, ((ROTATE, b"\1"),), exif=exif.tobytes()[6:])
    (tmp_path / "a.heic").write_bytes(turned)
    (photo, jpeg), unreadable = capture.photos.find_photos(tmp_path)
    assert not unreadable and photo.size == jpeg.size == (240, 160) and not photo.is_turned
    assert photo.device == jpeg.device and photo.focal == jpeg.focal is not None
    for longest in (400, 120):
        seen = [capture.read_photo(one, longest).astype(int) for one in (photo, jpeg)]
        assert np.abs(seen[0] - seen[1]).mean() < 4
    pose = {"transform_matrix": np.eye(4).tolist()}
    frames = [{"file_path": one.path.name, **pose} for one in (photo, jpeg)]
    scene = {"w": 240, "h": 160, "fl_x": 200.0, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(scene))
    views = [load_dataset(tmp_path, split).image(0).astype(int) for split in ("train", "test")]
    assert np.abs(views[0] - views[1]).mean() < 4


def test_the_camera_of_heic_is_known_without_decoding(tmp_path, monkeypatch):
    exif = Image.Exif()
    exif[0x010F], exif[0x0110] = "Maker", "Phone 3"
    pixels = np.zeros((48, 64, 3), np.uint8)
    (tmp_path / "a.heic").write_bytes(heic(pixels, exif=exif.tobytes()[6:]))
    monkeypatch.setattr(heif_decoding, "start", None)
    ((photo,), unreadable) = capture.photos.find_photos(tmp_path)
    assert not unreadable and photo.size == (64, 48) and photo.device[:2] == ("Maker", "Phone 3")


def test_damaged_heic_is_left_out_with_a_sentence(tmp_path):
    data = heic(np.zeros((48, 64, 3), np.uint8))
    (tmp_path / "a.heic").write_bytes(data[:-5])
    (tmp_path / "b.heic").write_bytes(data)
    ((photo,), (sentence,)) = capture.photos.find_photos(tmp_path)
    assert photo.path.name == "b.heic"
    assert sentence.endswith("can't be read as HEIC (it ends too early, or is damaged): "
                             "store it as JPEG")  # fmt: skip
