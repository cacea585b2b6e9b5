"""The photographs of a data set: the camera jumps to where each was taken.

Shapes: a photograph has H rows and W columns of pixels.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...core.render import Lens, distort, in_space
from ...core.training import DatasetError, list_images, read_image, shrunk_size, size_of
from . import orbit as orbits
from .framing import SMALLEST_SHARE, Covered, free_part

FARTHEST = 100.0  # model units, of a camera
WIDEST = np.radians(150.0)  # field of view
LONGEST_SIDE = 2048  # pixels, of what is shown


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

    def __init__(self, folder: Path, world_to_model, outside=False):
        """List the training photographs; none is read yet.

        Args:
            outside: Also those that lie outside the folder.

        Raises:
            DatasetError: The folder is no data set, or has no photograph.
        """
        listing = list_images(Path(folder), "train", outside)
        self._images, self.said = listing.images, listing.said
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
    size = size_of(image)
    lens = image.lens(*size)
    lens = lens.resized(*shrunk_size(size, LONGEST_SIDE))
    pixels = read_image(image, lens.width, lens.height)
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


class Places(NamedTuple):
    """Where the render and the photograph are in the window."""

    covered: Covered  # for the render: by panels, and by a photograph beside it
    axis: tuple[float, float]  # of the photograph's view [pixels]
    half_size: tuple[float, float]  # half of the width and height that it has [pixels]
    left: float  # its left border [pixels]


def places(size, covered: Covered, ratio: float, where: str) -> Places:
    """Both in what panels leave free, or each in a half of it.

    Args:
        size: Of the window [pixels].
        covered: By panels.
        ratio: Pixels a point.
        where: "over" or "beside".
    """
    left, top, width, height = free_part(size, covered, ratio)
    if where == "over":
        middle = left + 0.5 * width, top + 0.5 * height
        return Places(covered, middle, (0.5 * width, 0.5 * height), left)
    if 0.5 * width <= SMALLEST_SHARE * size[0]:  # halves that would not be used
        left, top, width, height = 0.0, 0.0, *size
    sides = left, top, size[0] - left - 0.5 * width, size[1] - top - height
    axis = left + 0.75 * width, top + 0.5 * height
    halved = Covered(*(side / ratio for side in sides))
    return Places(halved, axis, (0.25 * width, 0.5 * height), left + 0.5 * width)


def seen_from(photograph: Photograph, orbit, size, half_size, center):
    """The orbit from where a photograph was taken; all of it fits around its axis.

    Args:
        size: Of the window [pixels].
        half_size: Half of the width and height that there is [pixels].
        center: The object's, near which the orbit's target is.  [3]
    """
    lens, pose = photograph.lens, photograph.pose
    sides = zip((lens.width, lens.height), lens.center, lens.focal, half_size, strict=True)
    focal = min(half * f / max(c, length - c) for length, c, f, half in sides)
    # in_free_part scales the picture, unless all is free.
    height = size[1] if np.allclose(np.multiply(half_size, 2.0), size) else 2.0 * min(half_size)
    field_of_view = min(2.0 * math.atan(0.5 * height / focal), WIDEST)
    seen = orbits.looking_from(orbit, pose, center)
    return replace(seen, field_of_view=field_of_view, parallel=False)


def is_seen_from(photograph: Photograph, orbit) -> bool:
    """Whether the camera is where the photograph was taken."""
    return not orbit.parallel and np.allclose(orbit.pose, photograph.pose, atol=1e-5)
