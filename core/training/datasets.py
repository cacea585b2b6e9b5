"""Posed images on disk, in the Blender layout of NeRF-synthetic.

A folder holds transforms_<split>.json: `camera_angle_x`, the horizontal field of view in
radians, and `frames`, each with a `file_path` (relative, its ending may be left out) and a
`transform_matrix`, camera to world (OpenGL axes: the camera looks along −z, y is up).

The camera is a pinhole with its axis through the image's center; lens distortion and other
intrinsics that some tools write into the same file are not used.

Shapes: N views of H rows and W columns.
"""

import json
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError
from rich.console import Console
from rich.progress import Progress

from ..render.camera import Camera

ENDINGS = ("", ".png", ".webp", ".jpg", ".jpeg")
SILENT_SECONDS = 2.0  # a load that takes longer shows a progress bar


class DatasetError(ValueError):
    """The folder is not a data set that can be read; the message is one sentence for the user."""


@dataclass(frozen=True)
class Dataset:
    """The views of one split.

    Attributes:
        images: RGBA, straight alpha as stored; 255 where the file has none.  [N, H, W, 4] uint8
        poses: Camera to world.  [N, 4, 4] float64
        focal: In pixels, of the images as loaded.
        width, height: In pixels.
        names: One per view, the image's file name without its ending.
        split: "train", "test", ...
    """

    images: np.ndarray
    poses: np.ndarray
    focal: float
    width: int
    height: int
    names: tuple[str, ...]
    split: str

    def __post_init__(self):
        assert self.images.shape == (self.view_count, self.height, self.width, 4)
        assert self.poses.shape == (self.view_count, 4, 4), self.poses.shape

    @property
    def view_count(self) -> int:
        return len(self.names)

    @property
    def has_alpha(self) -> bool:
        """Whether any pixel is not opaque: then alpha is a measurement, else it is unknown."""
        return bool((self.images[..., 3] < 255).any())


def load(folder, split, image_size=None, view_count=None) -> Dataset:
    """Read one split.

    Args:
        folder: Where transforms_<split>.json is.
        split: "train", "test", ...
        image_size: Longer side in pixels to shrink the images to; they are never enlarged.
        view_count: Read that many views, spread evenly over the split; None reads all.

    Raises:
        DatasetError: Anything about the folder is not as it has to be.
    """
    for name, value in (("image size", image_size), ("number of views", view_count)):
        if value is not None and value < 1:
            raise DatasetError(f"The {name} is {value}: it has to be at least 1")
    folder = Path(folder)
    scene = read_transforms(folder, split)
    frames = scene["frames"]
    if view_count is not None and view_count < len(frames):
        chosen = np.linspace(0, len(frames) - 1, view_count).round().astype(int)
        frames = [frames[i] for i in chosen]
    paths = [image_path(folder, frame) for frame in frames]
    poses = np.stack([pose(frame) for frame in frames])
    images = read_images(paths, image_size)
    height, width = images.shape[1:3]
    focal = 0.5 * width / np.tan(0.5 * scene["camera_angle_x"])
    names = tuple(path.stem for path in paths)
    return Dataset(images, poses, float(focal), width, height, names, split)


def cameras(dataset: Dataset) -> list[Camera]:
    """The camera of each view, in world space."""
    size = dataset.width, dataset.height
    return [Camera(pose, dataset.focal, *size) for pose in dataset.poses]


def white_composite(images):
    """Straight-alpha RGBA over white, in [0, 1].  uint8 [..., 4] -> float32 [..., 3]"""
    values = np.asarray(images, np.float32) / 255.0
    alpha = values[..., 3:]
    return values[..., :3] * alpha + (1.0 - alpha)


def read_transforms(folder, split) -> dict:
    """transforms_<split>.json, checked as far as a file by itself can be."""
    path = folder / f"transforms_{split}.json"
    if not folder.is_dir():
        raise DatasetError(f"{folder} is not a folder: give the one that holds {path.name}")
    if not path.is_file():
        others = ", ".join(sorted(p.name for p in folder.glob("transforms*.json"))) or "none"
        raise DatasetError(f"{folder} holds no {path.name} (transforms files there: {others})")
    try:
        scene = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DatasetError(f"{path} is not JSON: {error}") from None
    if not isinstance(scene, dict) or not isinstance(scene.get("frames", []), list):
        raise DatasetError(f"{path} has to be a JSON object with a list of frames")
    if not scene.get("frames"):
        raise DatasetError(f"{path} lists no frames: there is nothing to load")
    angle = scene.get("camera_angle_x")
    if not isinstance(angle, int | float) or not 0.0 < angle < np.pi:
        raise DatasetError(
            f"{path} has camera_angle_x = {angle}: it has to be the horizontal field of view "
            f"in radians, between 0 and 3.14"
        )
    return scene


def image_path(folder, frame) -> Path:
    name = frame.get("file_path") if isinstance(frame, dict) else None
    if not isinstance(name, str) or not name:
        raise DatasetError(f"A frame of the data set in {folder} has no file_path")
    for ending in ENDINGS:
        path = folder / (name + ending)
        if path.is_file():
            return path
    raise DatasetError(
        f"The image {folder / name} is missing (tried as it is, and with .png, .webp, .jpg, .jpeg)"
    )


def pose(frame):
    """A frame's camera-to-world matrix.  [4, 4] float64"""
    try:
        matrix = np.array(frame["transform_matrix"], np.float64)
    except (KeyError, TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise DatasetError(
            f"The transform_matrix of {frame['file_path']} has to be 4 rows of 4 finite numbers"
        )
    return matrix


def read_images(paths, image_size=None):
    """All images, decoded by a few threads.  [N, H, W, 4] uint8"""
    images = None
    with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
        decoded = pool.map(lambda path: read_image(path, image_size), paths)
        for index, (image, size) in enumerate(slow_track(decoded, len(paths), "Loading images")):
            if images is None:
                images = np.empty((len(paths), *image.shape), np.uint8)
                first_size = size
            if size != first_size:
                raise DatasetError(
                    f"{paths[index]} has {size[0]}x{size[1]} pixels, but {paths[0].name} "
                    f"{first_size[0]}x{first_size[1]}: all images need one size"
                )
            images[index] = image
    return images


def read_image(path, image_size):
    """One image, shrunk if asked for, and its size (width, height) on disk."""
    try:
        with Image.open(path) as file:
            image = file.convert("RGBA")
    except (OSError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError):
        # Pillow raises SyntaxError where a PNG's chunks are broken.
        raise DatasetError(f"{path} can't be read as an image") from None
    size = image.size
    if image_size is not None and image_size < max(size):
        scale = image_size / max(size)
        smaller = tuple(max(1, round(scale * side)) for side in size)
        # A box filter is the mean over a pixel's area; Pillow weights RGBA by alpha for it.
        image = image.resize(smaller, Image.Resampling.BOX)
    return np.asarray(image), size


def slow_track(items, count, description):
    """Yield the items; show a progress bar once they have taken a while."""
    begin = time.monotonic()
    console = Console(stderr=True)
    progress = Progress(console=console, transient=True)
    task = progress.add_task(description, total=count)
    try:
        for item in items:
            yield item
            progress.advance(task)
            late = time.monotonic() - begin > SILENT_SECONDS
            if late and console.is_terminal and not progress.live.is_started:
                progress.start()
    finally:
        if progress.live.is_started:
            progress.stop()
