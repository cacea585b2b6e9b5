"""A sector of the views around an object, held out of training to be scored.

A view held out here and there lies between views of the training: its score tells how well a model
fills the gaps in.  The views of a sector have neighbors on both sides only: their score tells how
well the model shows a side that no training view shows.  Views from STEEP above or below are taken
from no side: they stay.

A view's azimuth is the direction from the point that the training views look at to the camera,
about the cameras' common up direction, counterclockwise from above, 0° at the first training view.
Of all sectors that begin at a view one with the usual number of views is held out: as many, or as
nearly as there is, as if the views were spread evenly over what they see around the object; of
several the first.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...base.schema import both, listing, number, text, vector
from .errors import DatasetError
from .layouts import list_images
from .posed_images import FARTHEST, PosedImage
from .views import AROUND, STEEP, directions_from, focus, offsets_from, up_of, widest_step

SECTOR = "sector"  # the split's name
WIDTH = 60.0  # degrees
LEAST = 3  # views in a sector; the mean score of fewer says little
SAME = 1e-6  # degrees between azimuths that are equal but for rounding


@dataclass(frozen=True)
class Sector:
    """What is held out.

    Attributes:
        begin: Azimuth [degrees]; the sector ends, exclusively, WIDTH after it.
        center: The point that the training views look at, in the data's space.  [3]
        up: The cameras' common up direction, a unit vector.  [3]
        zero: Where the azimuth is 0, a unit vector across `up`.  [3]
        views: Images of the sector, as `name_of` has them.
    """

    begin: float
    center: tuple[float, ...]
    up: tuple[float, ...]
    zero: tuple[float, ...]
    views: tuple[str, ...]

    def azimuths(self, poses) -> np.ndarray:
        """Of cameras in the data's space [degrees], below 360.  [n, 4, 4] -> [n]"""
        offsets = offsets_from(np.array(self.center), poses)
        left = np.cross(self.up, self.zero)
        found = np.degrees(np.arctan2(offsets @ left, offsets @ np.array(self.zero))) % 360.0
        return np.where(found > 360.0 - SAME, 0.0, found)

    def contains(self, poses) -> np.ndarray:
        """Whether cameras in the data's space lie in the sector.  [n, 4, 4] -> [n] bool"""
        return is_within(self.azimuths(poses), self.begin) & self.are_beside(poses)

    def are_beside(self, poses) -> np.ndarray:
        """Whether cameras are less than STEEP above or below the object.  [n, 4, 4] -> [n] bool"""
        heights = directions_from(np.array(self.center), poses) @ np.array(self.up)
        return abs(heights) < np.sin(np.radians(STEEP))

    def told(self) -> str:
        """The sector in words."""
        end = (self.begin + WIDTH) % 360.0
        return (
            f"{len(self.views)} training views, those from {self.begin:.0f}° to {end:.0f}° around "
            f"the object, counterclockwise from above; the first training view is at 0°"
        )

    def as_report(self) -> dict:
        """Plain JSON values."""
        rows = {name: list(getattr(self, name)) for name in ROWS}
        return {"sector": {"begin": self.begin, **rows}}

    @staticmethod
    def of_report(report: dict) -> "Sector | None":
        """What `as_report` wrote into a run's report, or a model's meta; None without one."""
        values = report.get("sector")
        known = isinstance(values, dict) and values.keys() >= VALUES.keys()
        if not known or not all(good(values[name]) for name, good in VALUES.items()):
            return None
        return Sector(float(values["begin"]), *(tuple(values[name]) for name in ROWS))


UNIT = vector(3, number(-1.001, 1.001))
ROWS = "center", "up", "zero", "views"
VALUES = {  # of a file
    "begin": number(0.0, 360.0),
    "center": vector(3, number(-FARTHEST, FARTHEST)),
    "up": UNIT,
    "zero": UNIT,
    "views": both(listing(text()), bool),
}


def is_within(azimuths, begin: float) -> np.ndarray:
    """Whether azimuths lie in the sector that begins there [degrees].  [n] -> [n] bool"""
    return (azimuths - begin + SAME) % 360.0 < WIDTH


def find_sector(folder: str | Path, outside: bool = False) -> Sector:
    """The sector to hold out of the training views of a data set.  Images are not read.

    Args:
        outside: As of load_dataset.

    Raises:
        DatasetError: The views look at no point, see less than half of the object around, or are
            too few; or the folder is not as it has to be.
    """
    folder = Path(folder)
    images = list_images(folder, "train", outside).images
    return sector_of([name_of(folder, image) for image in images], poses_of(images))


def sector_of(names: Sequence[str], poses: np.ndarray) -> Sector:
    """The same for views of these names.

    Args:
        poses: Camera to world, OpenGL's axes.  [n, 4, 4]
    """
    if len(poses) <= LEAST:
        raise DatasetError(f"{refused()}: there are {len(poses)} training views")
    try:
        center = focus(poses)
    except DatasetError:
        raise DatasetError(f"{refused()}: the cameras look at no common point") from None
    up = up_of(poses)
    flat = offsets_from(center, poses)
    flat -= np.outer(flat @ up, up)
    lengths = np.linalg.norm(flat, axis=1)
    first = int((lengths > 1e-6 * lengths.max()).argmax())  # one straight above has no azimuth
    zero = flat[first] / max(lengths[first], 1e-12)
    whole = Sector(0.0, tuple(center.tolist()), tuple(up.tolist()), tuple(zero.tolist()), ())
    azimuths = whole.azimuths(poses[whole.are_beside(poses)])
    sees = 360.0 - widest_step(azimuths) if len(azimuths) else 0.0
    if sees < AROUND:
        raise DatasetError(
            f"{refused()}: the cameras see {sees:.0f}° around the object, and at least "
            f"{AROUND:.0f}° are needed"
        )
    begins = np.sort(azimuths)
    counts = np.array([is_within(azimuths, begin).sum() for begin in begins])
    usual = len(azimuths) * WIDTH / sees
    begin = float(begins[np.abs(counts - usual).argmin()])
    inside = replace(whole, begin=begin).contains(poses)
    if inside.sum() < LEAST:
        raise DatasetError(
            f"{refused()}: it has only {inside.sum()} of the {len(poses)} training views, and at "
            f"least {LEAST} are needed for a score"
        )
    views = tuple(name for name, is_in in zip(names, inside, strict=True) if is_in)
    return replace(whole, begin=begin, views=views)


def refused() -> str:
    return f"a sector of {WIDTH:.0f}° can't be held out"


def poses_of(images: Sequence[PosedImage]) -> np.ndarray:
    """Camera to world.  [n, 4, 4]"""
    return np.array([image.camera_to_world for image in images]).reshape(-1, 4, 4)


def name_of(folder: Path, image: PosedImage) -> str:
    """An image's path from the folder, with slashes; its file's name on another drive."""
    path = image.path.resolve()
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # on Windows
        return path.name


def part_of(folder: Path, images: list[PosedImage], sector: Sector | None, held: bool):
    """The training images that the sector holds out, or else the others, in their order.

    Raises:
        DatasetError: Some that it holds out are not there: these are other images.  Or no sector
            is given.
    """
    if sector is None:
        raise DatasetError("which views a sector holds out is unknown without the sector")
    names, views = [name_of(folder, image) for image in images], set(sector.views)
    if lost := [view for view in sector.views if view not in names]:
        raise DatasetError(
            f"{len(lost)} of the {len(sector.views)} views that training held out are no training "
            f"images of {folder}, first {lost[0]}: give the data set that the model was trained on"
        )
    return [i for i, name in zip(images, names, strict=True) if (name in views) == held]
