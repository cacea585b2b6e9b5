"""The layout of NSVF (Liu et al. 2020), in which Tanks and Temples and others are published.

    rgb/<name>.png       images; the name's first digit is the split: 0_ train, 1_ and 2_ the
                         others (1_ is the test split where there is no 2_, else validation)
    pose/<name>.txt      camera to world, 4x4, OpenCV's axes (x right, y down, z forward)
    intrinsics.txt       4x4 with the focal length and the principal point in pixels, or
                         "f cx cy ..." in the first line
    bbox.txt             lowest and highest corner of the object's box, and a voxel size

The intrinsics that came with Tanks and Temples' Ignatius are known to be corrupt; what can't
be a camera's is refused.
"""

import numpy as np

from ...render import Lens
from .capture import (
    IMAGE_ENDINGS,
    Capture,
    DatasetError,
    View,
    checked_lens,
    from_opencv,
    rigid_pose,
)


def is_here(folder) -> bool:
    return (folder / "rgb").is_dir() and (folder / "pose").is_dir()


def read(folder, split) -> Capture:
    """The views of a split.

    Raises:
        DatasetError: A file is missing or not as it has to be.
    """
    poses, images, prefix = files_of(folder, split)
    if not poses:
        raise DatasetError(f"{folder / 'pose'} has no poses {prefix}*.txt, the {split} split")
    by_stem = {path.stem: path for path in images}
    lens = lens_reader(folder / "intrinsics.txt")
    views, missing = [], []
    for path in poses:
        if path.stem not in by_stem:
            missing.append(f"rgb/{path.stem}")
            continue
        pose = from_opencv(rigid_pose(numbers(path, (4, 4)), f"{path}"))
        views.append(View(by_stem[path.stem], pose, lens))
    if not views:
        raise DatasetError(f"none of the {len(missing)} images of the {split} split is in rgb/")
    bounds = None
    if (folder / "bbox.txt").is_file():
        values = numbers(folder / "bbox.txt")
        if len(values) < 6:
            raise DatasetError(f"{folder / 'bbox.txt'} has to begin with the six numbers of a box")
        bounds = values[:6].reshape(2, 3)
    return Capture(tuple(views), tuple(missing), bounds)


def files_of(folder, split):
    """A split's poses, the images of all splits, and how the split's names begin."""
    images = sorted(p for p in (folder / "rgb").iterdir() if p.suffix.lower() in IMAGE_ENDINGS)
    prefix = split_prefix({path.name[:2] for path in images}, split)
    return sorted((folder / "pose").glob(f"{prefix}*.txt")), images, prefix


def split_prefix(prefixes, split) -> str:
    if split == "train":
        return "0_"
    if split == "test":
        return "2_" if "2_" in prefixes else "1_"
    return "1_"


def numbers(path, shape=None):
    """The numbers of a text file, in that shape if one is given."""
    if not path.is_file():
        raise DatasetError(f"{path} is missing")
    try:
        values = np.array(path.read_text(encoding="utf-8").split(), np.float64)
        return values if shape is None else values.reshape(shape)
    except ValueError:
        raise DatasetError(
            f"{path} has to hold numbers" + (f", {shape[0]} rows of {shape[1]}" if shape else "")
        ) from None


def lens_reader(path):
    values = numbers(path)
    if len(values) == 16:
        matrix = values.reshape(4, 4)
        focal, center = (matrix[0, 0], matrix[1, 1]), (matrix[0, 2], matrix[1, 2])
    elif len(values) >= 3:
        focal, center = (values[0], values[0]), (values[1], values[2])
    else:
        raise DatasetError(f"{path} has to hold a 4x4 matrix, or a line 'f cx cy'")
    if not np.isfinite([*focal, *center]).all() or min(focal) <= 0 or min(center) <= 0:
        raise DatasetError(
            f"{path} is corrupt (as in the published Ignatius): focal lengths {focal}, "
            f"principal point {center}"
        )

    def lens(width, height):
        try:
            return checked_lens(
                Lens(width, height, tuple(map(float, focal)), tuple(map(float, center))), path
            )
        except DatasetError as error:
            raise DatasetError(f"{error}; the published Ignatius has such a file") from None

    return lens
