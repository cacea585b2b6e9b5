"""How near scored views are to those that a model was trained on."""

from dataclasses import dataclass

import numpy as np

from ..field import TetField
from ..render import in_space, views_of_rows
from .data.datasets import Dataset
from .data.sector import Sector
from .data.views import angles_to_nearest, directions_from, nearest_to_axes

WIDTH = 100  # of a training view; angles don't depend on it [pixels]


@dataclass(frozen=True)
class Nearness:
    """Of each scored view.

    Attributes:
        angles: To the nearest training view, seen from the point that the training views look at
            [degrees]; None if the model doesn't keep all its views, or they look at no point.
        inside: Whether it lies in the sector that training held out; None if it held none out.
    """

    angles: list[float] | None
    inside: list[bool] | None

    @staticmethod
    def of(field: TetField, dataset: Dataset) -> "Nearness":
        sector = Sector.of_report(field.meta)
        inside = None if sector is None else sector.contains(dataset.poses).tolist()
        return Nearness(angles(field, dataset.poses), inside)

    def of_view(self, index: int) -> dict:
        """What a report says of a view."""
        facts = {"angle": None if self.angles is None else self.angles[index]}
        return facts if self.inside is None else {**facts, "in_sector": self.inside[index]}


def angles(field: TetField, poses: np.ndarray) -> list[float] | None:
    """`Nearness.angles` of cameras in the data's space.  [n, 4, 4]"""
    rows = field.meta.get("views") or []
    cameras = views_of_rows(rows, WIDTH)
    if not cameras or len(cameras) < field.meta.get("view_count", len(rows)):
        return None  # the nearest may be one that the model doesn't keep
    trained = np.array([camera.camera_to_world for camera in cameras])
    center = nearest_to_axes(trained)
    if center is None:
        return None
    seen = directions_from(center, trained)
    asked = directions_from(center, in_space(poses, field.world_to_model))
    return angles_to_nearest(asked, seen).tolist()


def median_and_largest(values: list[float | None]) -> dict | None:
    """Of angles; None without values, or if one of them is None."""
    if not values or None in values:
        return None
    return {"median": float(np.median(values)), "largest": float(max(values))}


def angles_told(angles: dict | None) -> str:
    """What `median_and_largest` gives, in words; "" of None."""
    if angles is None:
        return ""
    median, largest = angles["median"], angles["largest"]
    return f"{median:.1f}° from the nearest training view (median; at most {largest:.1f}°)"
