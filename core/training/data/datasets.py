"""Posed images on disk: which layout a folder has, and its images in memory.

| layout | recognised by | read by |
|---|---|---|
| Blender, instant-ngp, nerfstudio | transforms_<split>.json, or transforms.json | transforms.py |
| NSVF (Tanks and Temples) | rgb/ and pose/ | nsvf.py |
| COLMAP | sparse/0/cameras.bin | colmap.py |

Shapes: N views of H_i rows and W_i columns, P pixels in all.
"""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError
from rich.console import Console
from rich.progress import Progress

from ...device import thread_count
from ...render import Camera, Lens
from . import colmap, nsvf, transforms
from .capture import Capture, DatasetError

SILENT_SECONDS = 2.0  # a load that takes longer shows a progress bar
UNREADABLE = (OSError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError)


@dataclass(frozen=True)
class Dataset:
    """The views of one split.

    Attributes:
        pixels: RGBA, straight alpha as stored, 255 where the file has none; view after view,
            row after row.  [P, 4] uint8
        poses: Camera to world, OpenGL's axes.  [N, 4, 4] float64
        lenses: Of each view, in pixels of the images as loaded.  [N]
        names: One per view, the image's file name without its ending.  [N]
        split: "train", "test", ...
        missing: Images that the files name but that are not there.
        bounds: Lowest and highest corner of the object's box, if the files have one.  [2, 3]
    """

    pixels: np.ndarray
    poses: np.ndarray
    lenses: tuple[Lens, ...]
    names: tuple[str, ...]
    split: str
    missing: tuple[str, ...] = ()
    bounds: np.ndarray | None = None

    def __post_init__(self):
        assert len(self.lenses) == len(self.names) == len(self.poses)
        assert self.pixels.shape == (self.first_pixels[-1], 4), self.pixels.shape
        assert self.poses.shape == (self.view_count, 4, 4), self.poses.shape

    @property
    def view_count(self) -> int:
        return len(self.names)

    @property
    def first_pixels(self):
        """Where each view's pixels begin, and P.  [N + 1]"""
        return np.cumsum([0, *(lens.width * lens.height for lens in self.lenses)])

    @property
    def has_alpha(self) -> bool:
        """Whether any pixel is not opaque: then alpha is a measurement, else it is unknown."""
        return bool((self.pixels[:, 3] < 255).any())

    def image(self, view: int):
        """RGBA of one view.  [H, W, 4] uint8"""
        first, last = self.first_pixels[view : view + 2]
        lens = self.lenses[view]
        return self.pixels[first:last].reshape(lens.height, lens.width, 4)

    def camera(self, view: int) -> Camera:
        """The camera of one view, in world space."""
        return Camera(self.poses[view], self.lenses[view])

    def subset(self, views) -> "Dataset":
        """Some of the views, by their numbers."""
        return from_images(
            [self.image(v) for v in views],
            self.poses[list(views)],
            [self.lenses[v] for v in views],
            [self.names[v] for v in views],
            self.split,
            self.missing,
            self.bounds,
        )


def from_images(images, poses, lenses, names, split, missing=(), bounds=None) -> Dataset:
    """A Dataset of images in memory, RGBA uint8 [H_i, W_i, 4] each."""
    pixels = np.concatenate([image.reshape(-1, 4) for image in images])
    return Dataset(
        pixels, np.asarray(poses), tuple(lenses), tuple(names), split, tuple(missing), bounds
    )


def load(folder, split, image_size=None, view_count=None) -> Dataset:
    """Read one split.

    Args:
        folder: The data set.
        split: "train", "test", ...
        image_size: Longer side in pixels to shrink the images to; they are never enlarged.
        view_count: Read that many views, spread evenly over the split; None reads all.

    Raises:
        DatasetError: Anything about the folder is not as it has to be.
    """
    for name, value in (("image size", image_size), ("number of views", view_count)):
        if value is not None and value < 1:
            raise DatasetError(f"The {name} is {value}: it has to be at least 1")
    capture = read_capture(Path(folder), split)
    views = capture.views
    if view_count is not None and view_count < len(views):
        chosen = np.linspace(0, len(views) - 1, view_count).round().astype(int)
        views = [views[i] for i in chosen]
    lenses = []
    for view in views:
        width, height = size_on_disk(view.path)
        lens = view.lens(width, height)
        lenses.append(lens.resized(*shrunk_size(width, height, image_size)))
    pixels = read_images([view.path for view in views], lenses)
    poses = np.stack([view.camera_to_world for view in views])
    names = tuple(view.path.stem for view in views)
    return Dataset(pixels, poses, tuple(lenses), names, split, capture.missing, capture.bounds)


def read_capture(folder, split) -> Capture:
    """What the files say of a split, in whichever layout the folder has."""
    if not folder.is_dir():
        raise DatasetError(f"{folder} is not a folder: give the one that holds the data set")
    if transforms.transforms_path(folder, split):
        return transforms.read(folder, split)
    if nsvf.is_here(folder):
        return nsvf.read(folder, split)
    if colmap.sparse_folder(folder):
        return colmap.read(folder, split)
    others = ", ".join(sorted(p.name for p in folder.glob("transforms*.json"))) or "none"
    raise DatasetError(
        f"{folder} holds no transforms_{split}.json (transforms files there: {others}), and "
        f"neither rgb/ and pose/ (NSVF) nor sparse/0/ (COLMAP)"
    )


def has_test_split(folder) -> bool:
    """Whether the files name views to score a model with; `load` finds what is wrong with them.

    Raises:
        DatasetError: A file that names the views of all splits can't be read.
    """
    folder = Path(folder)
    if transforms.transforms_path(folder, "test"):
        return transforms.has_split(folder, "test")
    if nsvf.is_here(folder):
        return bool(nsvf.files_of(folder, "test")[0])
    return colmap.sparse_folder(folder) is not None  # every eighth view of any


def white_composite(images):
    """Straight-alpha RGBA over white, in [0, 1].  uint8 [..., 4] -> float32 [..., 3]"""
    values = np.asarray(images, np.float32) / 255.0
    alpha = values[..., 3:]
    return values[..., :3] * alpha + (1.0 - alpha)


def size_on_disk(path):
    """Width and height, without decoding the image."""
    try:
        with Image.open(path) as file:
            return file.size
    except UNREADABLE:
        raise DatasetError(f"{path} can't be read as an image") from None


def shrunk_size(width, height, image_size):
    if image_size is None or image_size >= max(width, height):
        return width, height
    scale = image_size / max(width, height)
    return tuple(max(1, round(scale * side)) for side in (width, height))


def read_images(paths, lenses):
    """All images in their lenses' sizes, decoded by a few threads.  [P, 4] uint8"""
    first = np.cumsum([0, *(lens.width * lens.height for lens in lenses)])
    pixels = np.empty((first[-1], 4), np.uint8)

    def read(index):
        lens = lenses[index]
        image = read_image(paths[index], lens.width, lens.height)
        pixels[first[index] : first[index + 1]] = image.reshape(-1, 4)

    with ThreadPoolExecutor(min(8, thread_count())) as pool:
        for _ in slow_track(pool.map(read, range(len(paths))), len(paths), "Loading images"):
            pass
    return pixels


def read_image(path, width, height):
    """One image, shrunk to that size.  [H, W, 4] uint8"""
    try:
        with Image.open(path) as file:
            image = file.convert("RGBA")
    except UNREADABLE:  # Pillow raises SyntaxError where a PNG's chunks are broken
        raise DatasetError(f"{path} can't be read as an image") from None
    if image.size != (width, height):
        # A box filter is the mean over a pixel's area; Pillow weights RGBA by alpha for it.
        image = image.resize((width, height), Image.Resampling.BOX)
    return np.asarray(image)


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
