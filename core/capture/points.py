"""Sparse points: places on surfaces that several photographs show, found along with the cameras.

They lie in `points.npz` beside the `transforms.json` of the same photographs, in the same world:
+z is up (the cameras' mean up direction), the unit of length is arbitrary.  The file's arrays are
the attributes of `SparsePoints`.
"""

from dataclasses import dataclass, fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from ..paths import whole_file

POINTS_FILE = "points.npz"
SHAPES = {  # of each array: what follows n, and its type
    "points": ((3,), np.float32),
    "colors": ((3,), np.uint8),
    "track_length": ((), np.int32),
    "errors": ((), np.float32),
}
MOST_POINTS = 50_000_000  # that are read: 1.4 GB


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

    @property
    def count(self) -> int:
        return len(self.points)


def save_points(points: SparsePoints, folder: Path) -> Path:
    """Write points.npz into a folder; returns its path."""
    path = Path(folder) / POINTS_FILE
    with whole_file(path) as partial:
        np.savez_compressed(partial, **{f.name: getattr(points, f.name) for f in fields(points)})
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
        with np.load(path, allow_pickle=False) as archive:
            return SparsePoints(**{name: _array(archive, name) for name in SHAPES})
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, AssertionError) as error:
        reason = " ".join(str(error).split())[:100]
        raise ValueError(
            f"{path} does not hold the sparse points of photographs ({reason}): remove it, then "
            f"remove transforms.json beside it to have them found again"
        ) from None


def _array(archive, name):
    """One array, whose declared size is checked before it is read."""
    shape, kind = SHAPES[name]
    with archive.zip.open(f"{name}.npy") as file:
        version = np.lib.format.read_magic(file)
        reader = np.lib.format.read_array_header_1_0
        declared, _, dtype = (
            reader(file) if version == (1, 0) else np.lib.format.read_array_header_2_0(file)
        )
    if len(declared) != 1 + len(shape) or declared[0] > MOST_POINTS or dtype != kind:
        raise ValueError(f"{name} has the shape {declared} and the type {dtype}")
    values = archive[name]
    if not np.isfinite(values).all():
        raise ValueError(f"{name} holds numbers that are not finite")
    return values
