"""Open image files safely; all code that reads images uses this module.

Pillow knows some forty formats and recognizes them by a file's content, whatever its name.  For
PostScript it starts another program, and a small file can declare billions of pixels.  So this
module allows a list of formats, and checks the declared size before it decodes anything.  HEIC,
which telephones write, is none of Pillow's: core/base/heif.py reads it, in a process of its own
core/base/heif_decoding.py decodes it.
"""

import io
import logging
import warnings
from contextlib import contextmanager
from itertools import accumulate
from pathlib import Path

import numpy as np
from PIL import Image, TiffImagePlugin, TiffTags

from .heif import HeifError, is_heif, read_heif
from .heif_decoding import decode, is_possible
from .reading import check_file

FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP")
# Cameras' own formats; many are TIFFs whose first image is a preview.
RAW_ENDINGS = tuple(
    ".dng .cr2 .cr3 .crw .nef .nrw .arw .sr2 .srf .raf .orf .rw2 .rwl .pef .srw .x3f .3fr .fff "
    ".iiq .mos .erf .mef .mrw .dcr .kdc .gpr".split()
)
MOST_PIXELS = 100 * 2**20  # 400 MiB when decoded; the largest common cameras have 102 million
LARGE = 25 * 2**20  # pixels, 100 MiB: a damaged file is refused before it takes as much
AT_A_TIME = 2**20  # pixels of a TIFF's strips or tiles
ORIENTATION = 0x0112  # EXIF's tag: 1 is upright, 5 to 8 exchange width and height
DIRECT = {"RGBA", "RGB", "L", "LA", "1", "P", "PA"}  # Pillow's modes that convert to RGBA
BY_RGB = {"CMYK", "YCbCr", "RGBX"}
# TIFF's tags that say how a strip or a tile is to be decoded, and compressions that need
# nothing else: LZW, JPEG, Deflate twice, PackBits, LZMA, Zstandard.
CODING = (258, 259, 262, 266, 277, 317, 320, 338, 339, 347, 530, 531, 532)
IN_STRIPS = (5, 7, 8, 32946, 32773, 34925, 50000)
TURNS = {  # by orientation
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
HEIF_TURNS = {  # by quarters of a counterclockwise turn, by axis
    "rotate": (None, Image.Transpose.ROTATE_90, Image.Transpose.ROTATE_180,
               Image.Transpose.ROTATE_270),
    "mirror": (Image.Transpose.FLIP_TOP_BOTTOM, Image.Transpose.FLIP_LEFT_RIGHT),
}  # fmt: skip
BACK = {6: 8, 8: 6}  # orientations that undo a quarter turn; the others undo themselves

# Pillow warns of what open_image refuses in a sentence, and of harmless faults in metadata.
warnings.filterwarnings("ignore", module=r"PIL\.")
logging.getLogger("PIL").setLevel(logging.CRITICAL)


class ImageError(ValueError):
    """The image can't be read; the message is one sentence for the user."""


class HeifImage:
    """A HEIF file as far as it is an image of Pillow's here; it is not decoded yet.

    Attributes:
        size: Upright: such a file says itself how it is turned, and EXIF's orientation, which says
            the same, doesn't count.
    """

    format, mode = "HEIF", "RGB"

    def __init__(self, path):
        self.filename = str(path)
        self._file = read_heif(path, MOST_PIXELS)
        self.size = self.width, self.height = self._file.size

    def draft(self, mode, size) -> None:
        """Nothing: it has no smaller version of itself."""

    def exif(self):
        exif = Image.Exif()
        exif.load(self._file.exif)
        return exif

    def decode(self):
        """The image in Pillow's mode RGB; raises what heif_decoding.decode does."""
        image = Image.frombytes("RGB", self._file.stored, decode(self.filename, self._file))
        for what, *how in self._file.turns:
            if what == "crop":
                image = image.crop(how)
            elif (turn := HEIF_TURNS[what][how[0]]) is not None:  # one of Pillow's is 0
                image = image.transpose(turn)
        return image


@contextmanager
def open_image(path):
    """Yield a file as Pillow's image, or a HeifImage, not decoded yet.

    Raises:
        ImageError: It is missing, too large, damaged (the block may find that), or in a format
            that is not among FORMATS.
    """
    check_is_read(path)
    try:
        check_file(path)
        if is_heif(path):
            yield _heif(path)
            return
        with Image.open(path, formats=FORMATS) as image:
            width, height = image.size
            if width * height > MOST_PIXELS:
                raise ImageError(
                    f"{path} has {width}x{height} pixels, and at most {MOST_PIXELS >> 20} million "
                    f"are read: shrink it"
                )
            yield image
    except ImageError:
        raise
    except HeifError as error:
        raise ImageError(f"{path} can't be read as HEIC ({error}): {error.advice}") from None
    except Exception as error:  # of damaged files Pillow raises errors of a dozen kinds
        if getattr(error, "strerror", None):  # of the operating system
            raise ImageError(f"{path} can't be read: {error.strerror}") from None
        raise ImageError(
            f"{path} can't be read as an image: it has to be a whole {', '.join(FORMATS)} or "
            f"HEIC file"
        ) from None


def check_is_read(path) -> None:
    """ImageError for a camera's raw file, of which Pillow would read a small preview, as a TIFF."""
    if Path(str(path)).suffix.lower() in RAW_ENDINGS:
        raise ImageError(
            f"{path} is a camera's raw file, which is not read: export it as JPEG or TIFF"
        )


def _heif(path) -> HeifImage:
    if not is_possible():
        raise ImageError(
            f"{path} is a HEIC image, which is decoded by PyAV, and PyAV is not installed: pip "
            f"install av, or convert it to JPEG; an iPhone writes JPEG with Settings > Camera > "
            f"Formats > Most Compatible"
        )
    return HeifImage(path)


def exif_of(image):
    """The EXIF data, as Pillow's, of an image that isn't decoded yet."""
    # PNG's own getexif decodes the whole image to find a tag behind the pixels.
    return image.exif() if image.format == "HEIF" else Image.Image.getexif(image)


def orientation(image) -> int:
    """EXIF's number of how the camera was held, 1 to 8; of an image that isn't decoded yet."""
    if image.format == "HEIF":
        return 1
    tags = image.tag_v2 if image.format == "TIFF" else exif_of(image)
    value = tags.get(ORIENTATION, 1)
    return value if isinstance(value, int) and 1 <= value <= 8 else 1


def stored_size(image) -> tuple[int, int]:
    """Width and height before an orientation turns it; of an image that isn't decoded yet."""
    turned = image.format == "TIFF" and orientation(image) >= 5  # Pillow turns TIFFs itself
    return image.size[::-1] if turned else image.size


def _check_whole(image) -> None:
    """Raise an error for a file that ends too early, without the memory of its pixels."""
    length = Path(image.filename).stat().st_size
    if image.format in ("PNG", "JPEG"):
        with Image.open(image.filename, formats=FORMATS) as again:
            if image.format == "PNG":
                again.verify()  # checksums of what is compressed
            else:
                again.draft(None, (image.width // 8, image.height // 8))
                again.load()
        return
    needed = 0
    if image.format == "WEBP":  # RIFF, its length, WEBP
        with open(image.filename, "rb") as stream:
            needed = 8 + int.from_bytes(stream.read(8)[4:], "little")
    elif image.format == "TIFF":
        for offsets, counts in ((273, 279), (324, 325)):  # of strips, of tiles
            places = zip(image.tag_v2.get(offsets, ()), image.tag_v2.get(counts, ()), strict=False)
            needed = max([needed, *(offset + count for offset, count in places)])
    elif not image.info.get("compression"):  # BMP's rows are multiples of 4 bytes
        bits = {"1": 1, "L": 8, "P": 8}.get(image.mode, 24)
        needed = (image.width * bits + 31) // 32 * 4 * image.height
    if length < needed:
        raise OSError(f"{length} of {needed} bytes")
    if image.format == "TIFF" and image.tag_v2.get(259) in IN_STRIPS:
        for strips in _tiff_strips(image):
            with Image.open(strips, formats=("TIFF",)) as decoded:
                decoded.load()


def _tiff_strips(image):
    """Yield a TIFF's strips or tiles, some at a time, as files of their own: TIFFs in memory.

    There are none if its planes are apart, or its strips are not the usual ones.
    """
    tags, (width, bottom) = image.tag_v2, stored_size(image)
    rows = tags.get(278, bottom)
    offsets, counts, across = tags.get(273, ()), tags.get(279, ()), 1
    if tiled := 324 in tags:
        across = -(-width // tags[322])
        width, rows, offsets, counts = tags[322], tags[323], tags[324], tags[325]
    rows = rows if tiled else min(rows, bottom)
    strips, size = -(-bottom // rows) * across, Path(image.filename).stat().st_size
    if tags.get(284, 1) != 1 or not len(offsets) == len(counts) == strips or sum(counts) > size:
        return
    if width * rows > max(LARGE, image.width * image.height):
        raise OSError(f"tiles of {width}x{rows} pixels")
    many = max(AT_A_TIME // (width * rows), 1)
    for first in range(0, strips, many):
        lengths = counts[first : first + many]
        height = rows * len(lengths)
        directory = TiffImagePlugin.ImageFileDirectory_v2()
        for tag in CODING:
            if tag in tags:
                directory.tagtype[tag] = tags.tagtype[tag]
                directory[tag] = tags[tag]
        directory[256], directory[278], directory[279] = width, rows, lengths
        directory[257] = height if tiled else min(height, bottom - first * rows)
        directory.tagtype[273] = TiffTags.LONG  # offsets, which Pillow counts from the end
        directory[273] = tuple(accumulate(lengths[:-1], initial=0))
        file = io.BytesIO()
        file.write(b"II*\0\x08\0\0\0")
        directory.save(file)
        with open(image.filename, "rb") as stream:
            for offset, length in zip(offsets[first : first + many], lengths, strict=True):
                stream.seek(offset)
                file.write(stream.read(length))
        file.seek(0)
        yield file


def rgba(image, upright=False):
    """Decode an image that `open_image` yields; in Pillow's mode RGBA.

    Args:
        upright: Turn it as its EXIF orientation says; else it is as it is stored.
    """
    is_turned = image.format == "TIFF"  # by Pillow itself
    number = orientation(image) if upright or is_turned else 1
    if image.format == "HEIF":
        return image.decode().convert("RGBA")
    if image.width * image.height > LARGE:
        _check_whole(image)
    if image.mode.startswith("I;16") or (image.mode == "I" and image.format == "PNG"):
        values = np.asarray(image).astype(np.uint32)  # Pillow itself would clip them at 255
        decoded = Image.fromarray(((values * 255 + 32767) // 65535).astype(np.uint8))
    elif image.mode in DIRECT:
        image.load()
        decoded = image
    elif image.mode in BY_RGB:
        decoded = image.convert("RGB")
    else:
        raise ImageError(
            f"{image.filename} has pixels of a kind that is not read (Pillow calls it "
            f"{image.mode}): store 8 or 16 bits a color"
        )
    if number > 1 and upright != is_turned:
        decoded = decoded.transpose(TURNS[number if upright else BACK.get(number, number)])
    return decoded.convert("RGBA")
