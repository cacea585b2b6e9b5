"""The photographs of a data set: the camera jumps to where each was taken.

Shapes: a photograph has H rows and W columns of pixels.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..core.render import Lens, distort, in_space
from ..core.training import DatasetError, list_images, read_image, shrunk_size, size_on_disk
from . import orbit as orbits

FORMATS = "PNG", "JPEG", "WEBP"  # that are decoded
MOST_PIXELS = 100 * 2**20  # of a photograph on disk
FARTHEST = 100.0  # model units, of a camera
WIDEST = np.radians(150.0)  # field of view
LONGEST_SIDE = 2048  # pixels, of what is shown
PANEL_SPACE = 24.0  # points beside the panel


@dataclass(frozen=True)
class Photograph:
    """One that was read."""

    name: str
    pose: np.ndarray  # camera to model space  [4, 4]
    lens: Lens  # a pinhole's, of `pixels`
    pixels: np.ndarray  # RGBA, straight alpha  [H, W, 4] uint8
    undistorted: bool  # its lens was none


class Photographs:
    """The photographs of a data set, and the one that is looked at."""

    def __init__(self, folder: Path, world_to_model):
        """List the training photographs; none is read yet.

        Raises:
            DatasetError: The folder is no data set, or has no photograph.
        """
        self._images, _, _ = list_images(Path(folder), "train")
        if not self._images:
            raise DatasetError(f"{folder} has none of its photographs")
        self._world_to_model = world_to_model
        self.index: int | None = None
        self.shown: Photograph | None = None

    def __len__(self):
        return len(self._images)

    def step(self, by: int) -> Photograph:
        """Read the next one, or one of the others; the last is followed by the first.

        Raises:
            DatasetError: It can't be read; the one after it may.
        """
        first = 0 if by > 0 else len(self) - 1
        self.index = first if self.index is None else (self.index + by) % len(self)
        self.shown = None
        self.shown = read_photograph(self._images[self.index], self._world_to_model)
        return self.shown

    def says(self) -> str:
        """One line about the one that is looked at."""
        line = f"photograph {self.index + 1} of {len(self)}: {self.shown.name}"
        return line + (", without its lens's distortion" if self.shown.undistorted else "")


def read_photograph(image, world_to_model) -> Photograph:
    """Read one, without its lens's distortion.

    Raises:
        DatasetError: It is too large, damaged, or in another format.
    """
    size = size_on_disk(image.path, FORMATS)
    if size[0] * size[1] > MOST_PIXELS:
        raise DatasetError(
            f"{image.path} has {size[0]}x{size[1]} pixels, {MOST_PIXELS >> 20} million are the most"
        )
    lens = image.lens(*size)
    lens = lens.resized(*shrunk_size(size, LONGEST_SIDE))
    pixels = read_image(image.path, lens.width, lens.height, FORMATS)
    if lens.is_distorted:
        pixels = undistorted(pixels, lens)
    pose = in_space(image.camera_to_world, world_to_model)
    if not (np.abs(pose[:3, 3]) < FARTHEST).all():
        raise DatasetError(
            f"{image.path} was taken {np.abs(pose[:3, 3]).max():.3g} model sizes away: is this "
            f"the data set of this model?"
        )
    straight = replace(lens, radial=(0.0,) * 4, tangential=(0.0, 0.0))
    return Photograph(image.path.stem, pose, straight, pixels, lens.is_distorted)


def undistorted(pixels, lens: Lens):
    """What a pinhole of the same focal length had seen; transparent beside it.  [H, W, 4] uint8"""
    (fx, fy), (cx, cy), (height, width) = lens.focal, lens.center, pixels.shape[:2]
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    x, y = distort(lens, (u - cx) / fx, (v - cy) / fy)[:2]
    column, row = fx * x + cx - 0.5, fy * y + cy - 0.5
    inside = (column > -0.5) & (column < width - 0.5) & (row > -0.5) & (row < height - 0.5)
    column, row = np.clip(column, 0, width - 1), np.clip(row, 0, height - 1)
    left, top = column.astype(int), row.astype(int)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    across, down = ((a - b)[..., None] for a, b in ((column, left), (row, top)))
    upper = (1.0 - across) * pixels[top, left] + across * pixels[top, right]
    lower = (1.0 - across) * pixels[bottom, left] + across * pixels[bottom, right]
    mixed = ((1.0 - down) * upper + down * lower + 0.5).astype(np.uint8)
    return np.where(inside[..., None], mixed, 0).astype(np.uint8)


# -- where it is shown -------------------------------------------------------------------------


@dataclass(frozen=True)
class Places:
    """Where the axes of view are in the window [pixels], and how much room there is around each."""

    render: tuple[float, float]
    photograph: tuple[float, float]
    room: tuple[float, float]  # half the width and height of each
    left: float  # the photograph's left border


def places(size, ratio: float, settings) -> Places:
    """The middle of what the panel leaves free, or the middles of its two halves.

    Args:
        size: Of the window [pixels].
        ratio: Pixels a point.
    """
    width, height = size
    covered = (settings.panel_width + PANEL_SPACE) * ratio if settings.show_panel else 0.0
    covered = covered if covered < 0.6 * width else 0.0
    left = covered if settings.panel_side == "left" else 0.0
    free = width - covered
    middle = left + 0.5 * free, 0.5 * height
    if settings.photograph == "over":
        return Places(middle, middle, (0.5 * free, 0.5 * height), left)
    render, photograph = (left + share * free for share in (0.25, 0.75))
    room = 0.25 * free, 0.5 * height
    return Places((render, 0.5 * height), (photograph, 0.5 * height), room, middle[0])


def seen_from(photograph: Photograph, orbit, room, height: int, center):
    """The orbit from where a photograph was taken; all of it fits into the room around its axis.

    Args:
        room: Half of the width and height that there is [pixels].
        height: Of the image [pixels].
        center: The object's, near which the orbit's target is.  [3]
    """
    lens, pose = photograph.lens, photograph.pose
    sides = zip((lens.width, lens.height), lens.center, lens.focal, room, strict=True)
    focal = min(half * f / max(c, length - c) for length, c, f, half in sides)
    distance = (pose[:3, 3] - center) @ pose[:3, 2]
    distance = float(np.clip(distance, orbits.CLOSEST, orbits.FARTHEST))
    return replace(
        orbits.facing(orbit, pose[:3, :3]),
        target=pose[:3, 3] - distance * pose[:3, 2],
        distance=distance,
        field_of_view=min(2.0 * math.atan(0.5 * height / focal), WIDEST),
        parallel=False,
    )


def is_seen_from(photograph: Photograph, orbit) -> bool:
    """Whether the camera is where the photograph was taken."""
    return not orbit.parallel and np.allclose(orbits.pose(orbit), photograph.pose, atol=1e-5)
