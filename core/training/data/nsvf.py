"""The layout of NSVF (Liu et al. 2020), in which Tanks and Temples and others are published.

    rgb/<name>.png       images; the name's first digit is the split: 0_ train, 1_ and 2_ the
                         others (1_ is the test split if there is no 2_, else validation)
    pose/<name>.txt      camera to world, 4x4, OpenCV's axes (x right, y down, z forward)
    intrinsics.txt       4x4 with the focal length and the principal point in pixels, or
                         "f cx cy ..." in the first line
    bbox.txt             lowest and highest corner of the object's box, and a voxel size

The published intrinsics of Ignatius (Tanks and Temples) are corrupt; the reader refuses
intrinsics that no camera has.
"""

import numpy as np

from ...render import Lens
from .errors import DatasetError, NoSplitError
from .foreign_paths import find_files
from .posed_images import Listing, PosedImage, checked_lens, from_opencv, rigid_pose, text_of

IGNATIUS = "; the published Ignatius has such a file"


def is_here(folder) -> bool:
    return (folder / "rgb").is_dir() and (folder / "pose").is_dir()


def read(folder, split) -> Listing:
    """The images of a split, and the object's box."""
    prefix = {"train": "0_", None: ""}.get(split, "1_")
    if split == "test" and any((folder / "rgb").glob("2_*")):
        prefix = "2_"
    poses = sorted((folder / "pose").glob(f"{prefix}*.txt"))
    if not poses:
        raise NoSplitError(f"{folder / 'pose'} has no poses {prefix}*.txt, the {split} split")
    lens = lens_reader(folder / "intrinsics.txt")
    files = find_files(folder, [f"rgb/{path.stem}" for path in poses], folder / "pose")
    found, missing = [], []
    for path, image in zip(poses, files.paths, strict=True):
        if image:
            pose = from_opencv(rigid_pose(numbers(path, (4, 4)), f"{path}"))
            found.append(PosedImage(image, pose, lens))
        else:
            missing.append(f"rgb/{path.stem}")
    bounds = None
    if (folder / "bbox.txt").is_file():
        values = numbers(folder / "bbox.txt")
        if len(values) < 6:
            raise DatasetError(f"{folder / 'bbox.txt'} has to begin with the six numbers of a box")
        bounds = values[:6].reshape(2, 3)
    return Listing(found, missing, bounds, (files.said,) if files.said else ())


def numbers(path, shape=None):
    """The numbers of a text file, in that shape if one is given."""
    if not path.is_file():
        raise DatasetError(f"{path} is missing")
    try:
        values = np.array(text_of(path).split(), np.float64)
        return values if shape is None else values.reshape(shape)
    except DatasetError:
        raise
    except ValueError:
        raise DatasetError(
            f"{path} has to hold numbers" + (f", {shape[0]} rows of {shape[1]}" if shape else "")
        ) from None


def lens_reader(path):
    """The function that makes an image's lens from its width and height on disk."""
    values = numbers(path)
    if len(values) == 16:
        focal, center = (values[0], values[5]), (values[2], values[6])
    elif len(values) >= 3:
        focal, center = (values[0], values[0]), (values[1], values[2])
    else:
        raise DatasetError(f"{path} has to hold a 4x4 matrix, or a line 'f cx cy'")
    focal, center = tuple(map(float, focal)), tuple(map(float, center))
    if not np.isfinite([*focal, *center]).all() or min(*focal, *center) <= 0:
        raise DatasetError(
            f"{path} is corrupt: focal lengths {focal}, principal point {center}{IGNATIUS}"
        )

    def lens(width, height):
        try:
            return checked_lens(Lens(width, height, focal, center), path)
        except DatasetError as error:
            raise DatasetError(f"{error}{IGNATIUS}") from None

    return lens
