"""Sparse points: points on surfaces, found together with the photographs' cameras.

They are in `points.npz`, beside the `transforms.json` of the same photographs and in the same
world: +z is the cameras' mean up direction, the unit of length is arbitrary.  The file's arrays are
the attributes of `SparsePoints`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.archive import open_archive
from ...base.paths import whole_file
from ...base.schema import array, check, declared
from ...base.streams import one_line

POINTS_FILE = "points.npz"
SHAPES = {  # of each array: what follows n, and its type
    "points": ((3,), np.float32),
    "colors": ((3,), np.uint8),
    "track_length": ((), np.int32),
    "errors": ((), np.float32),
}
MOST_POINTS = 10_000_000  # that are read: 290 MB


@dataclass(frozen=True)
class SparsePoints:
    """Points of a capture.

    Attributes:
        points: Places in the world of transforms.json.  [n, 3] float32
        colors: Their mean color in the photographs.  [n, 3] uint8
        track_length: How many photographs a point was found in, at least 2.  [n] int32
        errors: Mean distance of a point's image from where it was found [pixels].  [n] float32
    """

    points: np.ndarray
    colors: np.ndarray
    track_length: np.ndarray
    errors: np.ndarray

    def __post_init__(self):
        for name, (shape, kind) in SHAPES.items():
            values = getattr(self, name)
            assert values.shape == (len(self.points), *shape), (name, values.shape)
            assert values.dtype == kind, (name, values.dtype)


def save_points(points: SparsePoints, folder: Path) -> Path:
    """Write points.npz into a folder; returns its path."""
    path = Path(folder) / POINTS_FILE
    with whole_file(path) as partial:
        np.savez_compressed(partial, **vars(points))
    return path


def load_points(folder: Path) -> SparsePoints | None:
    """The points that lie beside a folder's transforms.json; None without any.

    Raises:
        ValueError: The file is not as `save_points` writes it.
    """
    path = Path(folder) / POINTS_FILE
    if not path.is_file():
        return None
    try:
        with open_archive(path, "file of points") as arrays:
            count = len(declared(arrays, "points", np.float32, (None, 3)))
            check(count <= MOST_POINTS, f"at most {MOST_POINTS} points are read, it has {count}")
            return SparsePoints(
                **{
                    name: array(arrays, name, kind, (count, *shape))
                    for name, (shape, kind) in SHAPES.items()
                }
            )
    except MemoryError:
        raise
    except Exception as error:  # a file can hold anything: what was not foreseen is damage too
        reason = one_line(str(error).replace(str(path), POINTS_FILE), 100)
        raise ValueError(
            f"{path} does not hold the sparse points of photographs ({reason}): remove it to go on "
            f"without points, or transforms.json beside it as well to have both found again"
        ) from None
