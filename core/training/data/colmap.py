"""COLMAP's sparse reconstructions, read with pycolmap if it is installed.

A folder holds `images/` and `sparse/0/` (or `sparse/`, or `colmap/sparse/0/`).  Every eighth
view, in the order of the names, is a test view.  A reconstruction has no upright of its own:
the world is turned so that the cameras' mean upright is +z.
"""

from pathlib import Path

import numpy as np

from ...render import Lens
from .capture import EVERY_TEST_VIEW, Capture, DatasetError, View, checked_lens, from_opencv

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


def read(folder, split) -> Capture:
    """The views of a split.

    Raises:
        DatasetError: pycolmap is not installed, or the reconstruction can't be used.
    """
    try:
        import pycolmap
    except ImportError:
        raise DatasetError(
            f"{folder} is a COLMAP reconstruction: to read it, pip install pycolmap"
        ) from None
    sparse = sparse_folder(folder)
    try:
        reconstruction = pycolmap.Reconstruction(str(sparse))
    except (RuntimeError, ValueError) as error:
        raise DatasetError(f"{sparse} can't be read by pycolmap: {error}") from None
    images = sorted(reconstruction.images.values(), key=lambda image: image.name)
    poses, lenses = [], []
    for image in images:
        rigid = image.cam_from_world
        matrix = (rigid() if callable(rigid) else rigid).matrix()  # a method since pycolmap 3.12
        world_to_camera = np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]])
        poses.append(from_opencv(np.linalg.inv(world_to_camera)))
        lenses.append(lens_reader(reconstruction.cameras[image.camera_id], image.name))
    if not poses:
        raise DatasetError(f"{sparse} holds no registered images")
    turn = upright(np.mean([pose[:3, 1] for pose in poses], axis=0))
    views, missing = [], []
    for index, (image, pose, lens) in enumerate(zip(images, poses, lenses, strict=True)):
        if len(images) > 1 and (index % EVERY_TEST_VIEW == 0) != (split != "train"):
            continue
        path = folder / "images" / image.name
        if path.is_file():
            views.append(View(path, turn @ pose, lens))
        else:
            missing.append(f"images/{image.name}")
    if not views:
        raise DatasetError(f"none of the {len(missing)} {split} images is in {folder / 'images'}")
    return Capture(tuple(views), tuple(missing))


def upright(up):
    """The smallest rotation that takes a direction to +z.  [4, 4]"""
    up = np.asarray(up, float) / max(np.linalg.norm(up), 1e-12)
    z = np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(up, z), up @ z
    if cosine < -0.999999:
        return np.diag([1.0, -1.0, -1.0, 1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(4)
    turn[:3, :3] += cross + cross @ cross / (1.0 + cosine)
    return turn


def lens_reader(camera, name):
    model = getattr(camera.model, "name", str(camera.model))
    if model not in PARAMETERS:
        raise DatasetError(
            f"{name} was taken with COLMAP's camera model {model}, which is not read: use one of "
            f"{', '.join(PARAMETERS)}, or undistort the images"
        )
    fx, fy, cx, cy, k1, k2, p1, p2 = (
        0.0 if place is None else float(camera.params[place]) for place in PARAMETERS[model]
    )
    whole = Lens(camera.width, camera.height, (fx, fy), (cx, cy), (k1, k2, 0.0, 0.0), (p1, p2))

    def lens(width, height):
        return checked_lens(whole.resized(width, height), name)

    return lens
