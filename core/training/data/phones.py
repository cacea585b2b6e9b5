"""Scans of phones with LiDAR, as the programs Polycam and Record3D export them.

Both programs find cameras by ARKit during the scan.  Cameras look along -z; the world's y is up:

    Polycam, "raw data"      keyframes/corrected_images/<name>.jpg, and for each a camera in
                             corrected_cameras/<name>.json beside it: t_00 ... t_23, camera to
                             world, fx, fy, cx, cy, width, height; without these folders, images/
                             and cameras/
    Record3D, "EXR + RGB"    rgb/<i>.jpg and metadata.json: `poses` of all frames, a quaternion
                             (x, y, z, w) and a position; K, column after column, or
                             `perFrameIntrinsicCoeffs` (fx, fy, cx, cy); w, h
    Record3D's .r3d          is a zip of rgbd/<i>.jpg and the same file under the name `metadata`

The world is turned so that +z is up.  Every eighth image, in their order, is a test image.
"""

from pathlib import Path

import numpy as np

from ...render import Lens
from .errors import DatasetError
from .photo_files import photo_files
from .posed_images import (
    Listing,
    PosedImage,
    check_shape,
    checked_lens,
    is_of_split,
    json_of,
    rigid_pose,
    rotation_of,
)

Z_UP = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # from y up
POLYCAM = ("corrected_images", "corrected_cameras"), ("images", "cameras")
RECORD3D = ("rgb", "metadata.json"), ("rgbd", "metadata")


def is_here(folder) -> bool:
    return polycam_folders(folder) is not None or record3d_files(folder) is not None


def read(folder, split) -> Listing:
    """The images of a split."""
    found, missing = polycam(folder) if polycam_folders(folder) else record3d(folder)
    chosen = [image for i, image in enumerate(found) if is_of_split(i, len(found), split)]
    return Listing(chosen, missing)


def archive_of(path: Path) -> str:
    """What to do with a file that is a whole scan; empty if it is none."""
    if path.suffix.lower() == ".r3d":
        return f"{path} is a recording of Record3D: unzip it (it is a zip), and give that folder"
    if path.suffix.lower() == ".zip":
        return f"{path} is an archive: unzip it, and give that folder"
    return ""


# -- Polycam -----------------------------------------------------------------------------------


def polycam_folders(folder):
    """The folders of images and of their cameras, the corrected ones if they exist; or None."""
    for place in (folder / "keyframes", folder):
        for names in POLYCAM:
            images, cameras = (place / name for name in names)
            if images.is_dir() and cameras.is_dir() and any(cameras.glob("*.json")):
                return images, cameras
    return None


def polycam(folder):
    images, cameras = polycam_folders(folder)
    by_stem = {path.stem: path for path in photo_files(images)}
    found, missing = [], []
    for path in sorted(cameras.glob("*.json")):
        if path.stem not in by_stem:
            missing.append(f"{images.name}/{path.stem}")
            continue
        values = object_of(path)
        pose = [[values.get(f"t_{row}{column}") for column in range(4)] for row in range(3)]
        intrinsics = [values.get(key) for key in ("fx", "fy", "cx", "cy", "width", "height")]
        found.append(posed(by_stem[path.stem], pose, intrinsics, path))
    return found, missing


# -- Record3D ----------------------------------------------------------------------------------


def record3d_files(folder):
    """The folder of images and the file of their cameras; or None."""
    for images, metadata in RECORD3D:
        if (folder / images).is_dir() and (folder / metadata).is_file():
            return folder / images, folder / metadata
    return None


def record3d(folder):
    images, path = record3d_files(folder)
    values = object_of(path)
    poses, each = values.get("poses"), values.get("perFrameIntrinsicCoeffs")
    if not isinstance(poses, list):
        raise DatasetError(f"{path} has no list of poses, as Record3D writes one")
    common = shared_intrinsics(values.get("K"), path)
    each = each if isinstance(each, list) and len(each) == len(poses) else None
    size = [values.get("w"), values.get("h")]
    by_number = {int(p.stem): p for p in photo_files(images) if p.stem.isdecimal()}
    found, missing = [], []
    for number, pose in enumerate(poses):
        if number not in by_number:
            missing.append(f"{images.name}/{number}")
            continue
        own = each[number] if each else common
        if not isinstance(own, list) or len(own) != 4:
            raise DatasetError(f"{path} has no fx, fy, cx, cy of image {number}")
        pose = pose_of(pose, f"pose {number} of {path}")
        found.append(posed(by_number[number], pose, [*own, *size], path))
    return found, missing


def shared_intrinsics(matrix, path):
    """fx, fy, cx, cy of a matrix in a list, column after column; None without a matrix."""
    if matrix is None:
        return None
    if not isinstance(matrix, list) or len(matrix) != 9:
        raise DatasetError(f"{path} has a K that is no list of 9 numbers")
    return [matrix[i] for i in (0, 4, 6, 7)]


def pose_of(values, name):
    """The matrix of a quaternion (x, y, z, w) and a position.  [3, 4]"""
    is_list = isinstance(values, list) and len(values) == 7
    if not is_list or not all(isinstance(value, float) for value in values):
        raise DatasetError(f"{name} is no quaternion and position, 7 numbers")
    return np.column_stack([rotation_of(values[:4], name), values[4:]])


# -- both --------------------------------------------------------------------------------------


def object_of(path) -> dict:
    values = json_of(path)
    if not isinstance(values, dict):
        raise DatasetError(f"{path} is no object in braces")
    return values


def posed(image, pose, intrinsics, source) -> PosedImage:
    """An image with its camera.

    Args:
        pose: Camera to a world where y is up.  [3, 4]
        intrinsics: fx, fy, cx, cy, width, height of the image that they are for.
        source: The file that says so, for messages.
    """
    pose = Z_UP @ rigid_pose(pose, f"the pose of {image.name} in {source}")
    good = all(isinstance(value, float) and np.isfinite(value) for value in intrinsics)
    if not good or min(intrinsics[4:]) < 1.0:
        raise DatasetError(
            f"{source} lacks numbers of the camera of {image.name}: fx, fy, cx, cy, width, height"
        )
    fx, fy, cx, cy, *size = intrinsics

    def lens(width, height):
        check_shape((width, height), size, image.name, source)
        whole = Lens(*size, (fx, fy), (cx, cy))
        return checked_lens(whole.resized(width, height), f"{source}, {image.name}")

    return PosedImage(image, pose, lens, tuple(size))
