"""Image files of anybody: named formats, checked sizes, one kind of error."""

import re
import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest
from heif_files import MIRROR, ROTATE, heic
from PIL import EpsImagePlugin, Image, TiffImagePlugin

from deformrf.core.base import images
from deformrf.core.base.images import ImageError, open_image, rgba
from deformrf.core.base.paths import ROOT


def read(path, upright=False):
    with open_image(path) as image:
        return np.asarray(rgba(image, upright))


def test_postscript_named_png_starts_nothing(tmp_path, monkeypatch):
    path = tmp_path / "r_0.png"
    path.write_text(
        "%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 8 8\n%%EndComments\nshowpage\n%%EOF\n"
    )
    started = []
    monkeypatch.setattr(EpsImagePlugin, "Ghostscript", lambda *a, **k: started.append(a))
    with pytest.raises(ImageError, match=r"r_0\.png can't be read as an image.*PNG, JPEG"):
        read(path)
    assert not started


def test_images_are_opened_in_one_place():
    """Every other call would need the formats and the limit as well."""
    opens = re.compile(r"Image\.open\(|ImageFile\.Parser|imread\(")
    sources = [p for f in ("core", "wings", "commands", "viewer") for p in (ROOT / f).rglob("*.py")]
    found = [path.name for path in sources if opens.search(path.read_text(encoding="utf-8"))]
    assert found == ["images.py"]


def huge_png(path, side, bits=1):
    """A PNG of zeros, compressed to a few kilobytes."""

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    packer = zlib.compressobj(9)
    row = bytes(1 + (side * bits + 7) // 8)
    rows = b"".join(packer.compress(row) for _ in range(side)) + packer.flush()
    header = struct.pack(">IIBBBBB", side, side, bits, 0, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )
    return path


def test_a_size_is_checked_before_it_is_decoded(tmp_path):
    path = huge_png(tmp_path / "huge.png", 13_000)
    assert path.stat().st_size < 100_000
    program = f"""
import resource
from deformrf.core.base.images import ImageError, open_image, rgba
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    with open_image({str(path)!r}) as image:
        rgba(image)
except ImageError as error:
    print(error)
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    sentence, kilobytes = run.stdout.splitlines()
    assert sentence.endswith("has 13000x13000 pixels, and at most 100 million are read: shrink it")
    assert int(kilobytes) < 10_000  # it has 169 million pixels
    assert run.stderr == ""  # the sentence is all that is said


@pytest.mark.parametrize("ending, byte_order", [("png", "<"), ("tif", "<"), ("tif", ">")])
def test_16_bit_gray_keeps_its_shades(tmp_path, ending, byte_order):
    shades = np.array([[0, 1000, 128 * 257], [50_000, 65_000, 65_535]])
    path = tmp_path / f"gray.{ending}"
    Image.fromarray(shades.astype(byte_order + "u2")).save(path)
    pixels = read(path)
    for channel in range(3):
        np.testing.assert_array_equal(pixels[..., channel], np.round(shades / 257))
    assert (pixels[..., 3] == 255).all()


def test_what_has_no_8_or_16_bits_is_refused(tmp_path):
    """Floating point: its white is unknown."""
    path = tmp_path / "float.tif"
    Image.fromarray(np.full((4, 4), 0.5, np.float32)).save(path)
    with pytest.raises(ImageError, match=r"float\.tif has pixels of a kind .* calls it F\)"):
        read(path)


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "CMYK"])
def test_other_pixels_become_rgba(tmp_path, mode):
    colors = Image.effect_noise((9, 7), 90.0).convert("RGBA")
    image = colors.convert("RGB").convert(mode) if mode == "CMYK" else colors.convert(mode)
    path = tmp_path / ("a.tif" if mode == "CMYK" else "a.png")
    image.save(path)
    expected = image.convert("RGB").convert("RGBA") if mode == "CMYK" else image.convert("RGBA")
    np.testing.assert_array_equal(read(path), np.asarray(expected))


@pytest.mark.parametrize("number", range(1, 9))
@pytest.mark.parametrize("ending", ["png", "webp", "tif"])
def test_an_image_is_turned_as_its_camera_was(tmp_path, number, ending):
    image = Image.effect_noise((5, 3), 90.0).convert("RGB")
    exif = Image.Exif()
    exif[images.ORIENTATION] = number
    path = tmp_path / f"a.{ending}"
    image.save(path, exif=exif, lossless=True)
    stored, upright = read(path), read(path, upright=True)
    np.testing.assert_array_equal(stored[..., :3], np.asarray(image))
    # Row and column of the stored image of which the upright one shows the first.
    corner = {1: (0, 0), 2: (0, -1), 3: (-1, -1), 4: (-1, 0), 5: (0, 0), 6: (-1, 0)}
    corner |= {7: (-1, -1), 8: (0, -1)}
    assert upright.shape[:2] == ((3, 5) if number < 5 else (5, 3))
    np.testing.assert_array_equal(upright[0, 0], stored[corner[number]])


@pytest.mark.filterwarnings("ignore::UserWarning:PIL")  # as core/base/images.py does
def test_damaged_files_end_in_one_sentence(tmp_path):
    """Each format with bytes changed, cut or repeated; whatever Pillow raises, the error is one."""
    rng = np.random.default_rng()
    image = Image.fromarray(rng.integers(0, 256, (16, 16, 3), np.uint8))
    path, refused = tmp_path / "a.png", 0
    exif = Image.Exif()
    exif[images.ORIENTATION] = 6
    for kind in images.FORMATS:
        image.save(path, kind, **({"exif": exif} if kind != "BMP" else {}))
        whole = path.read_bytes()
        for _ in range(60):
            data = bytearray(whole)
            for place in rng.integers(0, min(len(data), 200), rng.integers(1, 6)):
                data[place] = rng.integers(256)
            path.write_bytes(data[: rng.integers(1, len(data) + 1)] if rng.random() < 0.3 else data)
            try:
                with open_image(path) as opened:
                    images.orientation(opened)
                    rgba(opened, upright=True)
            except ImageError as error:
                refused += 1
                assert str(path) in str(error) and "\n" not in str(error)
    assert refused > 100


def test_pillow_adds_no_line_to_the_sentence(tmp_path, caplog):
    path = tmp_path / "a.tif"
    Image.new("RGB", (4, 4)).save(path)
    count = struct.pack("<HHIHH", 277, 3, 1, 3, 0)  # samples of a pixel
    assert count in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(count, count[:8] + b"\xf4\xf4" + count[10:]))
    with pytest.raises(ImageError):
        read(path)
    assert not caplog.records


@pytest.mark.parametrize("ending", ["png", "jpg", "webp", "tif", "bmp"])
def test_a_large_file_that_ends_early_takes_no_memory(tmp_path, monkeypatch, ending):
    """Of a whole one nothing is refused."""
    monkeypatch.setattr(images, "LARGE", 1000)
    path = tmp_path / f"a.{ending}"
    noise = np.random.default_rng().integers(0, 256, (96, 80, 3), np.uint8)
    Image.fromarray(noise).save(path)
    assert read(path).shape == (96, 80, 4)
    for options in {"tif": ({"compression": "tiff_lzw"},), "png": ({"optimize": True},)}.get(
        ending, ()
    ):
        Image.fromarray(noise[..., 0]).save(path, **options)
        assert read(path).shape == (96, 80, 4)
    path.write_bytes(path.read_bytes()[:-3000])
    full = []
    load = images.Image.Image.convert
    monkeypatch.setattr(images.Image.Image, "convert", lambda *a: full.append(1) or load(*a))
    with pytest.raises(ImageError, match="can't be read as an image"):
        read(path)
    assert not full


def tiled_tiff(path, pixels, side):
    """A TIFF of gray `pixels` [H, W] in deflated tiles, which Pillow doesn't write itself."""
    height, width = pixels.shape
    padded = np.pad(pixels, ((0, -height % side), (0, -width % side)))
    rows, columns = padded.shape[0] // side, padded.shape[1] // side
    tiles = padded.reshape(rows, side, columns, side).swapaxes(1, 2).reshape(-1, side, side)
    parts = [zlib.compress(tile.tobytes()) for tile in tiles]
    ifd = TiffImagePlugin.ImageFileDirectory_v2()
    ifd[256], ifd[257], ifd[258], ifd[259], ifd[262], ifd[277] = width, height, (8,), 8, 1, 1
    ends = 8 + np.cumsum([0, *map(len, parts)])
    ifd[322], ifd[323], ifd[324], ifd[325] = side, side, tuple(ends[:-1]), tuple(map(len, parts))
    path.write_bytes(
        b"II*\0" + struct.pack("<I", ends[-1]) + b"".join(parts) + ifd.tobytes(int(ends[-1]))
    )


@pytest.mark.parametrize("kind", ["lzw", "adobe_deflate", "jpeg", "lzma", "16 bits", "P", "tiles"])
def test_a_large_tiff_is_decoded_part_by_part_first(tmp_path, monkeypatch, kind):
    """A whole one is as ever; of a damaged one only the parts before the damage are decoded."""
    path, loaded = tmp_path / "a.tif", []
    noise = np.random.default_rng().integers(0, 256, (500, 300, 3), np.uint8)
    image = Image.fromarray(noise)
    if kind == "tiles":
        tiled_tiff(path, noise[..., 0], 64)
    elif kind == "16 bits":
        Image.fromarray(noise[..., 0] * np.uint16(200)).save(path, compression="tiff_lzw")
    else:
        image = image.convert("P") if kind == "P" else image
        image.save(path, compression=f"tiff_{kind}" if kind in ("lzw", "adobe_deflate") else
                   {"P": "tiff_lzw"}.get(kind, kind))  # fmt: skip
    expected = read(path)
    if kind == "tiles":
        np.testing.assert_array_equal(expected[..., 0], noise[..., 0])
    monkeypatch.setattr(images, "LARGE", 5000)
    monkeypatch.setattr(images, "AT_A_TIME", 60_000)  # some parts together
    load = TiffImagePlugin.TiffImageFile.load
    monkeypatch.setattr(
        TiffImagePlugin.TiffImageFile, "load", lambda self: loaded.append(self.size) or load(self)
    )
    np.testing.assert_array_equal(read(path), expected)
    parts = [size for size in loaded if size != (300, 500)]
    assert len(parts) >= 2
    if kind == "jpeg":  # its decoder passes over damage
        return
    with Image.open(path) as image:
        tags = image.tag_v2
        begin, length = (int(tags[t][-1]) for t in ((324, 325) if 324 in tags else (273, 279)))
    data = bytearray(path.read_bytes())
    data[begin : begin + length // 2] = bytes(length // 2)
    path.write_bytes(data)
    loaded.clear()
    with pytest.raises(ImageError, match="can't be read as an image"):
        read(path)
    assert loaded == parts


def smooth(width, height):
    noise = np.random.default_rng().integers(40, 216, (5, 7, 3), np.uint8)
    return np.asarray(Image.fromarray(noise).resize((width, height), Image.Resampling.BILINEAR))


def exif_with(number):
    exif = Image.Exif()
    exif[images.ORIENTATION] = number
    exif[0x0110] = "Phone 3"
    return exif.tobytes()[6:]  # behind "Exif"


# EXIF's orientation, and what a HEIF file has instead.
SAME_TURNS = {
    1: (),
    2: ((MIRROR, b"\1"),),
    3: ((ROTATE, b"\2"),),
    4: ((MIRROR, b"\0"),),
    5: ((ROTATE, b"\1"), (MIRROR, b"\0")),
    6: ((ROTATE, b"\3"),),
    7: ((ROTATE, b"\3"), (MIRROR, b"\0")),
    8: ((ROTATE, b"\1"),),
}


@pytest.mark.parametrize("number", SAME_TURNS)
def test_heic_is_turned_once(tmp_path, number):
    """By its own boxes, as EXIF turns a PNG; the EXIF orientation, which it has too, is not."""
    pixels = smooth(70, 50)
    path = tmp_path / "a.heic"
    path.write_bytes(heic(pixels, 64, SAME_TURNS[number], exif=exif_with(number)))
    exif = Image.Exif()
    exif[images.ORIENTATION] = number
    Image.fromarray(pixels).save(tmp_path / "a.png", exif=exif)
    expected = read(tmp_path / "a.png", upright=True)
    for upright in (True, False):
        found = read(path, upright)
        assert found.shape == expected.shape and (found[..., 3] == 255).all()
        assert np.abs(found.astype(int) - expected).mean() < 3.0
    with open_image(path) as image:
        assert image.size == images.stored_size(image) == expected.shape[1::-1]
        assert images.orientation(image) == 1 and images.exif_of(image)[0x0110] == "Phone 3"


def test_content_decides_between_heic_and_others(tmp_path):
    """Telephones and messengers change names."""
    pixels = smooth(64, 48)
    (tmp_path / "a.jpg").write_bytes(heic(pixels))
    Image.fromarray(pixels).save(tmp_path / "b.jpg", quality=95)
    (tmp_path / "b.jpg").rename(tmp_path / "b.heic")
    for name in ("a.jpg", "b.heic"):
        assert np.abs(read(tmp_path / name)[..., :3].astype(int) - pixels).mean() < 4.0


def test_heic_without_pyav_is_one_sentence(tmp_path, monkeypatch):
    path = tmp_path / "a.heic"
    path.write_bytes(heic(smooth(64, 48)))
    monkeypatch.setattr(images, "is_possible", lambda: False)
    with pytest.raises(ImageError, match=r"pip install av, or .* Camera > Formats > Most Compat"):
        read(path)


def test_damaged_heic_ends_in_one_sentence(tmp_path):
    """Bytes of its boxes changed, cut or repeated; a few reach the decoder."""
    rng = np.random.default_rng()
    whole = heic(smooth(70, 50), 64, SAME_TURNS[5], exif=exif_with(6))
    boxes = whole.index(b"mdat") + 100
    path, refused = tmp_path / "a.heic", 0
    for _ in range(150):
        data = bytearray(whole)
        for place in rng.integers(16, boxes, rng.integers(1, 6)):
            data[place] = rng.choice([0, 1, 127, 255, rng.integers(256)])
        path.write_bytes(data[: rng.integers(1, len(data) + 1)] if rng.random() < 0.3 else data)
        try:
            with open_image(path) as image:
                images.exif_of(image)
                if rng.random() < 0.2:
                    rgba(image, upright=True)
        except ImageError as error:
            refused += 1
            assert str(path) in str(error) and str(error).isprintable()
    assert refused > 30


@pytest.mark.parametrize("name", ["a.DNG", "a.cr2", "a.CR3", "a.nef", "a.arw", "a.raf", "a.orf"])
def test_raw_files_are_refused_by_name(tmp_path, name):
    """Many are TIFFs whose first image is a small preview."""
    Image.new("RGB", (16, 12)).save(tmp_path / name, "TIFF")
    with pytest.raises(ImageError, match=rf"{name} is a camera's raw file, .* as JPEG or TIFF"):
        read(tmp_path / name)
