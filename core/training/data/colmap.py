"""COLMAP's sparse reconstructions, whose files colmap_files.py reads.

A folder has `images/` and one or several models.  Models are in `sparse/` or `colmap/sparse/`, or
in subfolders of these (`sparse/0/`, `sparse/1/`, ...); a single model may also lie beside
`images/`.  Of several models, the reader takes the one with the most images that exist.  Every
eighth image, in the order of the names, is a test image.  A reconstruction has no vertical axis of
its own, so the reader turns the world until the mean up direction of the cameras is +z.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...render import Lens
from .colmap_files import ColmapCamera, Registered, read_cameras, read_images
from .colmap_files import read_points as points_of
from .errors import DatasetError
from .foreign_paths import FoundFiles, find_files
from .posed_images import Listing, PosedImage, check_shape, checked_lens, from_opencv, is_of_split
from .views import upright

# Where each model has fx, fy, cx, cy, k1, k2, p1, p2 among its parameters; None is zero.
PARAMETERS = {
    "SIMPLE_PINHOLE": (0, 0, 1, 2, None, None, None, None),
    "PINHOLE": (0, 1, 2, 3, None, None, None, None),
    "SIMPLE_RADIAL": (0, 0, 1, 2, 3, None, None, None),
    "RADIAL": (0, 0, 1, 2, 3, 4, None, None),
    "OPENCV": (0, 1, 2, 3, 4, 5, 6, 7),
}
PLACES = ("sparse", "colmap/sparse")
MOST_MODELS = 1000  # COLMAP itself makes at most 50


@dataclass(frozen=True)
class Reconstruction:
    """A model whose files have been read.

    Attributes:
        folder: Of the model.
        ending: Of its files, ".bin" or ".txt".
        cameras: By number.
        images: In the order of their names.
        files: Of the images; None where one doesn't exist.
    """

    folder: Path
    ending: str
    cameras: dict[int, ColmapCamera]
    images: list[Registered]
    files: FoundFiles

    @property
    def present(self) -> int:
        return sum(path is not None for path in self.files.paths)

    @property
    def poses(self):
        """Camera to world, OpenGL's axes.  [N, 4, 4]"""
        return np.array([from_opencv(np.linalg.inv(i.world_to_camera)) for i in self.images])


def sparse_folders(folder: Path) -> list[Path]:
    """The folders of models: numbered ones first, then others by name, then what holds them."""
    found = []
    for place in PLACES:
        inner = (folder / place).glob("*")
        ordered = sorted(inner, key=lambda p: (not p.name.isdecimal(), len(p.name), p.name))
        kinds = ("cameras", "images")
        found += [p for p in (*ordered, folder / place) if any(endings_of(p, k) for k in kinds)]
    if not found and endings_of(folder, "cameras", "images"):
        return [folder]
    return found[:MOST_MODELS]


def endings_of(folder: Path, *names) -> list[str]:
    """The endings, COLMAP's binary one first, under which a model has all of these files."""
    endings = (".bin", ".txt")
    return [e for e in endings if all(os.path.isfile(folder / f"{n}{e}") for n in names)]


def is_here(folder: Path) -> bool:
    return bool(sparse_folders(folder))


def read(folder, split) -> Listing:
    """The images of a split, and those missing."""
    chosen, said = largest(folder)
    cameras = [camera_of(chosen, image) for image in chosen.images]
    poses = chosen.poses
    turn = turn_upright(poses)
    found, missing = [], []
    rows = zip(chosen.images, cameras, poses, chosen.files.paths, strict=True)
    for index, (image, camera, pose, path) in enumerate(rows):
        if not is_of_split(index, len(chosen.images), split):
            continue
        if path:
            lens = lens_reader(camera, image.name[:200], chosen.folder)
            found.append(PosedImage(path, turn @ pose, lens, (camera.width, camera.height)))
        else:
            missing.append(f"images/{image.name}")
    return Listing(found, missing, None, said)


def read_points(folder):
    """The reconstruction's points, in the world that `read` turns; None without any.  [n, 3]"""
    chosen, _ = largest(folder)
    path = chosen.folder / f"points3D{chosen.ending}"
    if not path.is_file():
        return None
    try:
        points = points_of(path)
    except DatasetError as error:
        raise DatasetError(f"{error}: copy it anew, or remove it to train without points") from None
    return points @ turn_upright(chosen.poses)[:3, :3].T if len(points) else None


def largest(folder) -> tuple[Reconstruction, tuple[str, ...]]:
    """The model with the most images that exist; a sentence about all, if there are several.

    Raises:
        DatasetError: None of them can be read; it says why the first can't.
    """
    models, unreadable, told = [], [], []
    for sparse in sparse_folders(folder):
        name = sparse.relative_to(folder)
        try:
            model = reconstruction_of(sparse, folder)
        except DatasetError as error:
            unreadable.append(error)
            told.append(f"{name} can't be read ({error})")
            continue
        models.append(model)
        told.append(f"{name} has {model.present} of its {len(model.images)} photographs")
    if not models:
        raise unreadable[0]
    # The first of equals.
    chosen = max(models, key=lambda model: (model.present, len(model.images)))
    said = [chosen.files.said] if chosen.files.said else []
    if len(told) > 1:
        used = f"of {len(told)} COLMAP models {chosen.folder.relative_to(folder)} is used"
        said.append(f"{used}: {listed(told)}")
    return chosen, tuple(said)


def listed(sentences, most=10) -> str:
    more = len(sentences) - most
    return ", ".join(sentences[:most]) + (f", and {more} more" if more > 0 else "")


def reconstruction_of(sparse: Path, folder: Path) -> Reconstruction:
    """The model in a folder of a data set's; DatasetError if it can't be read."""
    endings = endings_of(sparse, "cameras", "images")
    if not endings:
        raise DatasetError(
            f"{sparse} has to hold cameras.bin and images.bin, or cameras.txt and images.txt: one "
            f"of the two is missing"
        )
    cameras = read_cameras(sparse / f"cameras{endings[0]}")
    registered = read_images(sparse / f"images{endings[0]}")
    files = find_files(folder, [f"images/{image.name}" for image in registered], sparse)
    return Reconstruction(sparse, endings[0], cameras, registered, files)


def camera_of(model: Reconstruction, image: Registered) -> ColmapCamera:
    """The camera that took an image; DatasetError without one."""
    if image.camera not in model.cameras:
        raise DatasetError(
            f"{model.folder} has no camera {image.camera}, which is that of {image.name[:200]}"
        )
    return model.cameras[image.camera]


def turn_upright(poses):
    """The rotation of the world that takes the cameras' mean up direction to +z.  [4, 4]"""
    turn = np.eye(4)
    turn[:3, :3] = upright(np.mean(poses[:, :3, 1], axis=0))
    return turn


def lens_reader(camera: ColmapCamera, name, sparse):
    """The function that makes an image's lens from its width and height."""
    if camera.model not in PARAMETERS:
        raise DatasetError(
            f"{name} was taken with COLMAP's camera model {camera.model[:40]}, which is not read: "
            f"use one of {', '.join(PARAMETERS)}, or undistort the images"
        )
    fx, fy, cx, cy, k1, k2, p1, p2 = (
        0.0 if place is None else camera.parameters[place] for place in PARAMETERS[camera.model]
    )
    size = camera.width, camera.height
    whole = Lens(*size, (fx, fy), (cx, cy), (k1, k2, 0.0, 0.0), (p1, p2))

    def lens(width, height):
        check_shape((width, height), size, name, sparse)
        return checked_lens(whole.resized(width, height), name)

    return lens
