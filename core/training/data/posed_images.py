"""Paths, poses and lenses of a data set, read before its images.

Each layout has a function `read(folder, split)` that returns a Listing (transforms.py, nsvf.py,
colmap.py, phones.py).  For the split None it lists all images.
"""

import codecs
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...base.reading import read_bytes
from ...render import Lens, has_rays
from .errors import DatasetError

if TYPE_CHECKING:
    from .turning import Turning

FARTHEST = 1e12  # that a camera may be, so that no product overflows
SHAPE_TOLERANCE = 0.02  # between the stated width : height and the image's
EVERY_TEST_VIEW = 8  # for data without a split, as in LLFF and mip-NeRF 360
SHORTEST_QUATERNION = 1e-9


@dataclass(frozen=True)
class PosedImage:
    """An image, its camera's pose and lens."""

    path: Path | None  # None: it doesn't exist
    camera_to_world: np.ndarray  # [4, 4] OpenGL's axes: the camera looks along -z, y is up
    lens: Callable[[int, int], Lens]  # given width and height of the image
    stated_size: tuple[float, float] | None = None  # width and height by the data set's files
    upright: bool = False  # the files say that the camera is that of the image turned by EXIF
    turning: "Turning | None" = None  # what tells it where they don't
    mask: Path | None = None  # that the files name for it; None: it isn't there either
    mask_name: str = ""  # as the files name it
    ring: int = -1  # of photographs from one camera that stood still; -1: it is in none


class Listing(NamedTuple):
    """What the files of a data set say of a split.

    Attributes:
        images: Those that exist.
        missing: The names of the others.
        bounds: Lowest and highest corner of the object's box; None without one.  [2, 3]
        said: Sentences about what the user may not expect of these files.
    """

    images: list[PosedImage]
    missing: list[str]
    bounds: np.ndarray | None = None
    said: tuple[str, ...] = ()


def is_of_split(index: int, count: int, split: str | None) -> bool:
    """Whether image `index` of `count` belongs to a split, where the files define no split.

    Every eighth image is a test image, but not a single one.
    """
    if split is None:
        return True
    is_test = count > 1 and index % EVERY_TEST_VIEW == 0
    return is_test == (split != "train")


def text_of(path: Path) -> str:
    """A text file of a data set; DatasetError if it is none, too long, or not in Unicode."""
    try:
        data = read_bytes(path)
        is_wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        return data.decode("utf-16" if is_wide else "utf-8-sig")
    except OSError as error:
        raise DatasetError(f"{path} can't be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise DatasetError(f"{path} is not a text file (UTF-8)") from None


def json_of(path: Path):
    """The value of a JSON file; all its numbers are floats, too large ones infinite.

    Raises:
        DatasetError: As of `text_of`; or it is not JSON.
    """
    text = text_of(path)
    try:
        return json.loads(text, parse_int=float)  # which reads no number digit by digit
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path} is not JSON: {error}") from None


def have_one_shape(size, other) -> bool:
    """Whether two sizes (width, height) have about the same ratio of sides."""
    across, down = size[0] * other[1], size[1] * other[0]
    return down < across * (1 + SHAPE_TOLERANCE) and across < down * (1 + SHAPE_TOLERANCE)


def check_shape(size, stated, name, source):
    """DatasetError unless an image has the shape that the data set's files state for it.

    The sides of a shrunk image may have been rounded, up or down.
    """
    (width, height), (w, h) = size, stated
    is_rounded = width < w and height < h and abs(width * h - height * w) < max(stated)
    if not is_rounded and not have_one_shape(size, stated):
        raise DatasetError(
            f"{source} says that images have {stated[0]:g}x{stated[1]:g} pixels, but {name} has "
            f"{size[0]}x{size[1]}: turned or cropped images need intrinsics of their own"
        )


def rigid_pose(values, name):
    """A camera-to-world matrix.  [4, 4] float64

    Raises:
        DatasetError: It is not 4x4, not finite, beyond FARTHEST, mirrors or distorts, or has its
            position in its last row.
    """
    try:
        matrix = np.array(values, np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape == (3, 4):
        matrix = np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]])
    if matrix.shape != (4, 4) or not (np.abs(matrix) <= FARTHEST).all():
        raise DatasetError(f"{name} has to be 4 rows of 4 finite numbers, up to {FARTHEST:g}")
    if np.abs(matrix[3, :3]).max() > 1e-4:
        row = " ".join(f"{value:g}" for value in matrix[3])
        raise DatasetError(
            f"{name} has to end in the row 0 0 0 1, and ends in {row}: if it is transposed, write "
            f"its columns as rows"
        )
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if (lengths < 1e-8).any():
        raise DatasetError(f"{name} is no camera pose: an axis has no length")
    matrix[:3, :3] /= lengths  # some programs write scaled axes
    axes = matrix[:3, :3]
    if np.abs(axes.T @ axes - np.eye(3)).max() > 1e-2 or np.linalg.det(axes) < 0.0:
        raise DatasetError(f"{name} is no camera pose: its axes are skew or mirrored")
    return matrix


def rotation_of(quaternion, name):
    """The rotation of a quaternion (x, y, z, w) of any length.  [3, 3]

    Raises:
        DatasetError: Its length is about zero, or not finite.
    """
    length = math.hypot(*quaternion)
    if not SHORTEST_QUATERNION < length < math.inf:
        raise DatasetError(f"{name} has no rotation: its quaternion has the length {length:g}")
    x, y, z, w = (value / length for value in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def from_opencv(camera_to_world):
    """The pose with OpenGL's axes of a camera that looks along +z, y down.  [4, 4]"""
    return camera_to_world * np.array([1.0, -1.0, -1.0, 1.0])


def checked_lens(lens: Lens, where) -> Lens:
    """The lens, if a camera can have it.

    Raises:
        DatasetError: No camera has such numbers, or a pixel has no ray.
    """
    numbers = np.array([*lens.focal, *lens.center, *lens.radial, *lens.tangential])
    size = np.array([lens.width, lens.height])
    pixels = f"{lens.width}x{lens.height} pixels"
    if not np.isfinite(numbers).all():
        raise DatasetError(f"{where}: the intrinsics are not all finite numbers")
    if min(lens.focal) < 0.05 * size.max() or min(lens.focal) > 100 * size.max():
        raise DatasetError(
            f"{where}: the focal lengths {lens.focal[0]:g} and {lens.focal[1]:g} can't be those "
            f"of an image of {pixels}"
        )
    if (np.abs(np.array(lens.center) / size - 0.5) > 0.5).any():
        raise DatasetError(
            f"{where}: the principal point ({lens.center[0]:g}, {lens.center[1]:g}) lies outside "
            f"the image of {pixels}"
        )
    if not has_rays(lens):
        distortion = (*lens.radial, *lens.tangential)
        raise DatasetError(
            f"{where}: with the distortion {distortion} some of the {pixels} have no ray"
        )
    return lens
