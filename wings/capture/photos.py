"""Photographs in a folder: how large they are, and what EXIF says of the camera.

Sizes are those of the upright image, that is, turned as its EXIF orientation says: all of this
room works on upright images.
"""

from dataclasses import dataclass
from math import hypot
from pathlib import Path

import numpy as np
from PIL import Image

from ...core.base.images import (
    ImageError,
    exif_of,
    open_image,
    orientation,
    rgba,
    stored_size,
)
from ...core.training import photo_files, shrunk_size

IMAGE_SIZE = 1600  # longer side that photographs are worked at [pixels]
EXIF_FOLDER = 0x8769
MAKE, MODEL, FOCAL_LENGTH, FOCAL_LENGTH_35MM = 0x010F, 0x0110, 0x920A, 0xA405
DIAGONAL_35MM = hypot(36.0, 24.0)  # mm, of the film that focal lengths are converted to
SHORTEST_35MM, LONGEST_35MM = 5.0, 3000.0  # mm, of lenses that exist


class CaptureError(ValueError):
    """No cameras can be found; the message is one sentence for the user, with what to do."""


@dataclass(frozen=True)
class Photo:
    """A photograph that can be opened.

    Attributes:
        path: Its file.
        size: Width and height, upright [pixels].
        is_turned: Whether EXIF says that it isn't stored upright.
        focal: Focal length by EXIF [pixels of the upright image]; None if it isn't known.
        device: Equal for photographs of one camera with one focal length and size.
    """

    path: Path
    size: tuple[int, int]
    is_turned: bool
    focal: float | None
    device: tuple


def find_photos(folder: Path) -> tuple[list[Photo], list[str]]:
    """The photographs of a folder by name; for each file that can't be read, why.

    Nothing is decoded yet, so a damaged file may be found later.
    """
    photos, unreadable = [], []
    for path in photo_files(folder):
        try:
            photos.append(photo_of(path))
        except ImageError as error:
            unreadable.append(str(error))
    return photos, unreadable


def photo_of(path: Path) -> Photo:
    """Read a file's header; ImageError if it is no image."""
    with open_image(path) as image:
        number = orientation(image)
        size = stored_size(image)[::-1] if number >= 5 else image.size
        make, model, focal_length, focal_35mm = camera_by_exif(image)
    focal = None
    if focal_35mm is not None and SHORTEST_35MM <= focal_35mm <= LONGEST_35MM:
        focal = focal_35mm / DIAGONAL_35MM * hypot(*size)
    device = (make, model, focal_length, focal_35mm, *size)
    return Photo(path, size, number > 1, focal, device)


def camera_by_exif(image):
    """Make, model, focal length [mm], the same for 35 mm film; each None where nothing says."""
    try:
        exif = exif_of(image)
        inner = exif.get_ifd(EXIF_FOLDER)
    except Exception:  # damaged metadata end in errors of many kinds, and decide nothing
        return None, None, None, None
    return (
        text(exif.get(MAKE)),
        text(exif.get(MODEL)),
        number(inner.get(FOCAL_LENGTH)),
        number(inner.get(FOCAL_LENGTH_35MM)),
    )


def text(value) -> str | None:
    return value.strip("\0 ")[:100] if isinstance(value, str) else None


def number(value) -> float | None:
    """A positive number of EXIF, rounded to what two photographs of one lens have in common."""
    try:
        value = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return round(value, 2) if 0.0 < value < 1e5 else None


def read_photo(photo: Photo, longest: int) -> np.ndarray:
    """Decode a photograph, upright, on white, shrunk to that longer side.  [h, w, 3] uint8

    Raises:
        ImageError: It can't be read.
    """
    size = shrunk_size(photo.size, longest)
    with open_image(photo.path) as image:
        swapped = image.size != photo.size
        image.draft("RGB", size[::-1] if swapped else size)  # a JPEG decodes at half its size
        decoded = rgba(image, upright=True)
    if decoded.getextrema()[3][0] < 255:
        white = Image.new("RGBA", decoded.size, (255, 255, 255, 255))
        decoded = Image.alpha_composite(white, decoded)
    decoded = decoded.convert("RGB")
    if decoded.size != size:
        decoded = decoded.resize(size, Image.Resampling.BOX)
    return np.asarray(decoded)
