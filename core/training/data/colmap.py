"""COLMAP's sparse reconstructions, read with the package pycolmap.

A folder holds `images/` and `sparse/0/` (or `sparse/`, or `colmap/sparse/0/`).  Every eighth
image, in the order of the names, is a test image.  A reconstruction has no vertical axis of its
own: the reader turns the world so that the mean up direction of the cameras is +z.
"""

from pathlib import Path

import numpy as np

from ...capture import load_pycolmap, upright
from ...render import Lens
from .foreign_paths import find_files
from .posed_images import (
    DatasetError,
    Listing,
    PosedImage,
    check_shape,
    checked_lens,
    from_opencv,
    is_of_split,
    rigid_pose,
)

# Where each model has fx, fy, cx, cy, k1, k2, p1, p2 among its parameters; None is zero.
PARAMETERS = {
    "SIMPLE_PINHOLE": (0, 0, 1, 2, None, None, None, None),
    "PINHOLE": (0, 1, 2, 3, None, None, None, None),
    "SIMPLE_RADIAL": (0, 0, 1, 2, 3, None, None, None),
    "RADIAL": (0, 0, 1, 2, 3, 4, None, None),
    "OPENCV": (0, 1, 2, 3, 4, 5, 6, 7),
}


def sparse_folder(folder) -> Path | None:
    for name in ("sparse/0", "sparse", "colmap/sparse/0", "colmap/sparse"):
        if any((folder / name / f"cameras.{ending}").is_file() for ending in ("bin", "txt")):
            return folder / name
    return None


def read(folder, split) -> Listing:
    """The images of a split; ModuleNotFoundError without pycolmap."""
    sparse, reconstruction, registered, poses = reconstruction_of(folder)
    cameras = [camera_of(reconstruction, image, sparse) for image in registered]
    turn = turn_upright(poses)
    files = find_files(folder, [f"images/{image.name}" for image in registered], sparse)
    found, missing = [], []
    for index, (image, pose, camera) in enumerate(zip(registered, poses, cameras, strict=True)):
        if not is_of_split(index, len(registered), split):
            continue
        if path := files.paths[index]:
            lens, size = lens_reader(camera, image.name, sparse), (camera.width, camera.height)
            found.append(PosedImage(path, turn @ pose, lens, size))
        else:
            missing.append(f"images/{image.name}")
    return Listing(found, missing, None, (files.said,) if files.said else ())


def read_points(folder):
    """The reconstruction's points, in the world that `read` turns.  [n, 3]"""
    _, reconstruction, _, poses = reconstruction_of(folder)
    points = np.array([point.xyz for point in reconstruction.points3D.values()]).reshape(-1, 3)
    return points @ turn_upright(poses)[:3, :3].T


def reconstruction_of(folder):
    """The folder of a reconstruction, itself, its images in the order of their names, their poses.

    DatasetError if it can't be read; ModuleNotFoundError without pycolmap.
    """
    pycolmap = load_pycolmap()
    sparse = sparse_folder(folder)
    try:
        reconstruction = pycolmap.Reconstruction(str(sparse))
        registered = sorted(reconstruction.images.values(), key=lambda image: image.name)
    except Exception as error:  # pycolmap's C++ ends in errors of many kinds, over several lines
        reason = " ".join(str(error).split())[:200]
        raise DatasetError(f"{sparse} can't be read by pycolmap: {reason}") from None
    if not registered:
        raise DatasetError(f"{sparse} holds no registered images")
    return sparse, reconstruction, registered, [pose_of(image) for image in registered]


def pose_of(image):
    """Camera to world, OpenGL's axes.  [4, 4]"""
    rigid = image.cam_from_world
    matrix = (rigid() if callable(rigid) else rigid).matrix()  # a method since pycolmap 3.12
    world_to_camera = rigid_pose(matrix, f"the pose of {image.name}")
    return from_opencv(np.linalg.inv(world_to_camera))


def camera_of(reconstruction, image, sparse):
    """The camera that took an image; DatasetError without one."""
    if image.camera_id not in reconstruction.cameras:
        raise DatasetError(
            f"{sparse} has no camera {image.camera_id}, which is that of {image.name}"
        )
    return reconstruction.cameras[image.camera_id]


def turn_upright(poses):
    """The rotation of the world that takes the cameras' mean up direction to +z.  [4, 4]"""
    turn = np.eye(4)
    turn[:3, :3] = upright(np.mean([pose[:3, 1] for pose in poses], axis=0))
    return turn


def lens_reader(camera, name, sparse):
    """The function that makes an image's lens from its width and height."""
    model = getattr(camera.model, "name", str(camera.model))
    if model not in PARAMETERS:
        raise DatasetError(
            f"{name} was taken with COLMAP's camera model {model}, which is not read: use one of "
            f"{', '.join(PARAMETERS)}, or undistort the images"
        )
    fx, fy, cx, cy, k1, k2, p1, p2 = (
        0.0 if place is None else float(camera.params[place]) for place in PARAMETERS[model]
    )
    size = camera.width, camera.height
    whole = Lens(*size, (fx, fy), (cx, cy), (k1, k2, 0.0, 0.0), (p1, p2))

    def lens(width, height):
        check_shape((width, height), size, name, sparse)
        return checked_lens(whole.resized(width, height), name)

    return lens
