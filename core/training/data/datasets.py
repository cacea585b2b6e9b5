"""Load the posed images of a split into memory, from a folder in any layout.

Shapes: N views of H_i rows and W_i columns, P pixels in all.
"""

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from PIL import Image

from ...base.device import thread_count
from ...base.images import ImageError, open_image, orientation, rgba, stored_size
from ...base.memory import free_bytes
from ...render import Lens
from .errors import DatasetError, NoImagesError, NoSplitError
from .foreign_paths import tried
from .layouts import list_images, sparse_points
from .masks import mask_paths, named_masks, read_mask
from .posed_images import PosedImage
from .sector import SECTOR, Sector, part_of
from .turning import is_turned

Item = TypeVar("Item")

DECODED_BYTES = 12  # a pixel on disk takes while it is decoded: Pillow's two images, an array
PIXELS_MAX = 2**31 - 1  # that a RayBank takes: Warp's arrays and kernels count in int32


@dataclass(frozen=True)
class Dataset:
    """The views of one split.

    Attributes:
        pixels: RGBA, straight alpha as stored, 255 where the file has none; view after view,
            row after row.  [P, 4] uint8
        poses: Camera to world, OpenGL's axes.  [N, 4, 4] float64
        lenses: Lens of each view, in pixels of the images as loaded.  [N]
        names: One per view, the image's file name without its ending.  [N]
        split: "train", "test", ...
        missing: Images that the files name but that are not there.
        bounds: Lowest and highest corner of the object's box, if the files have one.  [2, 3]
        masked: Whether alpha comes from masks of whole photographs.
        rings: The ring of each view, photographs from a camera that stood still while the object
            turned; -1 for others.  None if there are none.  [N] int
        said: Sentences about what the user may not expect of the files.
        points: Places on surfaces that were found along with the cameras, if the files have such,
            and if it is for training.  [n, 3]
        sector: What was held out of training views.
    """

    pixels: np.ndarray
    poses: np.ndarray
    lenses: tuple[Lens, ...]
    names: tuple[str, ...]
    split: str
    missing: tuple[str, ...] = ()
    bounds: np.ndarray | None = None
    points: np.ndarray | None = None
    masked: bool = False
    said: tuple[str, ...] = ()
    rings: np.ndarray | None = None
    sector: Sector | None = None

    def __post_init__(self):
        assert len(self.lenses) == len(self.names) == len(self.poses)
        assert self.pixels.shape == (self.first_pixels[-1], 4), self.pixels.shape
        assert self.poses.shape == (self.view_count, 4, 4), self.poses.shape

    @property
    def view_count(self) -> int:
        return len(self.names)

    @property
    def first_pixels(self) -> np.ndarray:
        """The first pixel of each view, and P.  [N + 1]"""
        return np.cumsum([0, *(lens.width * lens.height for lens in self.lenses)])

    @property
    def has_alpha(self) -> bool:
        """Whether any pixel is not opaque: then alpha is a measurement, else it is unknown."""
        return bool((self.pixels[:, 3] < 255).any())

    def image(self, view: int) -> np.ndarray:
        """RGBA of one view.  [H, W, 4] uint8"""
        first, last = self.first_pixels[view : view + 2]
        lens = self.lenses[view]
        return self.pixels[first:last].reshape(lens.height, lens.width, 4)


def load_dataset(
    folder: str | Path,
    split: str,
    image_size: int | None = None,
    view_count: int | None = None,
    for_training: bool = False,
    outside: bool = False,
    masks: str | Path | None = None,
    sector: Sector | None = None,
) -> Dataset:
    """Read one split.

    Args:
        folder: The data set.
        split: "train", "test", ...; "sector" are the training views that `sector` holds out.
        image_size: Longer side in pixels to shrink the images to; they are never enlarged.
        view_count: Read that many views, spread evenly over the split; None reads all.
        for_training: Refuse more pixels than a RayBank takes.
        outside: Read images that lie outside the folder, too.
        masks: Folder of the images' masks (masks.py), which become their alpha; each image needs
            one if it is for training.  None: those that the files name, if they do.
        sector: Held out of "train" (see sector.py, `find_sector`); other splits are read whole.

    Raises:
        NoSplitError: The files list no such images.
        NoImagesError: None of the images is there.
        DatasetError: Anything else about the folder is not as it has to be.
    """
    for name, value in (("image size", image_size), ("number of views", view_count)):
        if value is not None and value < 1:
            raise DatasetError(f"The {name} is {value}: it has to be at least 1")
    listed = "train" if split == SECTOR else split
    images, missing, bounds, said = list_images(Path(folder), listed, outside)
    if split == SECTOR or (sector is not None and split == "train"):
        images = part_of(Path(folder), images, sector, held=split == SECTOR)
        missing = missing if split != SECTOR else []
    points = sparse_points(Path(folder), split) if for_training else None
    check_some(images, missing, split)
    if view_count is not None and view_count < len(images):
        chosen = np.linspace(0, len(images) - 1, view_count).round().astype(int)
        images = [images[i] for i in chosen]
    sizes = [size_of(image) for image in images]
    said += images[0].turning.said()
    shrunk = [shrunk_size(size, image_size) for size in sizes]
    if for_training:
        check_pixel_count(shrunk)
    threads = decoding_threads(sizes, shrunk)
    lenses = [
        image.lens(*size).resized(*small)
        for image, size, small in zip(images, sizes, shrunk, strict=True)
    ]
    if masks is not None:
        mask_files = mask_paths(masks, images, needed=for_training)
    else:
        mask_files, told = named_masks(images, needed=for_training)
        said = (*said, told) if told else said
    masked = masks is not None or any(mask_files)
    pixels = read_images(images, lenses, threads, mask_files)
    if masked and not pixels[:, 3].any():
        where = f"in {masks}" if masks is not None else "that mask_path names"
        raise DatasetError(f"the masks {where} are black everywhere: white is the object")
    poses = np.stack([image.camera_to_world for image in images])
    names = tuple(image.path.stem for image in images)
    return Dataset(
        pixels,
        poses,
        tuple(lenses),
        names,
        split,
        tuple(missing),
        bounds,
        points,
        masked=masked,
        said=said,
        rings=np.array([image.ring for image in images]) if masked else None,
        sector=sector if split == "train" else None,
    )


def check_some(images: Sequence[PosedImage], missing: Sequence[str], split: str) -> None:
    """NoSplitError if the files of a data set list no images, NoImagesError if none is there."""
    if not images and not missing:
        raise NoSplitError(f"the data set names no {split} images")
    if not images:
        raise NoImagesError(
            f"none of the {len(missing)} {split} images is there: {tried(missing[0])}"
        )


def white_composite(images: np.ndarray) -> np.ndarray:
    """Straight-alpha RGBA over white, in [0, 1].  uint8 [..., 4] -> float32 [..., 3]"""
    values = np.asarray(images, np.float32) / 255.0
    alpha = values[..., 3:]
    return values[..., :3] * alpha + (1.0 - alpha)


def size_of(image: PosedImage) -> tuple[int, int]:
    """Width and height as the image's lens sees it, without decoding the image.

    Raises:
        DatasetError: It can't be read.
    """
    try:
        with open_image(image.path) as file:
            swapped = is_turned(image, file) and orientation(file) >= 5
            return stored_size(file)[::-1] if swapped else stored_size(file)
    except ImageError as error:
        raise DatasetError(str(error)) from None


def shrunk_size(size: tuple[int, int], image_size: int | None) -> tuple[int, int]:
    """Width and height with `image_size` as the longer side, if that is smaller."""
    if image_size is None or image_size >= max(size):
        return size
    scale = image_size / max(size)
    return tuple(max(1, round(scale * side)) for side in size)


def pixel_count(sizes, image_size=None) -> int:
    """The pixels of images of these sizes, if they are shrunk to that longer side."""
    return sum(width * height for width, height in (shrunk_size(s, image_size) for s in sizes))


def longest_side(sizes, pixels) -> int:
    """The largest --image-size with which images have no more pixels than that."""
    sides = range(max(map(max, sizes)))
    return bisect_left(sides, True, key=lambda side: pixel_count(sizes, side + 1) > pixels)


def check_pixel_count(sizes):
    """DatasetError, which names an --image-size, if these are too many pixels to train on."""
    count = pixel_count(sizes)
    if count > PIXELS_MAX:
        raise DatasetError(
            f"the {len(sizes)} training images have {count / 1e9:.2f} billion pixels together, "
            f"and at most {PIXELS_MAX / 1e9:.2f} billion can be trained on: give --image-size "
            f"{longest_side(sizes, PIXELS_MAX)}, or less"
        )


def decoding_threads(sizes, shrunk) -> int:
    """How many images may be decoded at once in the memory that is free.

    Args:
        sizes: Width and height of each image on disk.
        shrunk: The same as loaded.

    Raises:
        DatasetError: All images don't fit; it names an --image-size.
    """
    most, free = min(8, thread_count()), free_bytes()
    if free is None:
        return most
    taken, decoded = 4 * pixel_count(shrunk), DECODED_BYTES * max(w * h for w, h in sizes)
    if taken + decoded > free:
        side = longest_side(shrunk, (free - decoded) // 4)
        raise DatasetError(
            f"the {len(sizes)} images take {(taken + decoded) / 1e9:.2f} GB of memory, and "
            f"{free / 1e9:.2f} GB are free: "
            + (f"give --image-size {side}, or less" if side else "end other programs")
        )
    return max(1, min(most, (free - taken) // max(decoded, 1)))


def read_images(images, lenses, threads, masks):
    """All images in their lenses' sizes, decoded by that many threads.  [P, 4] uint8

    Args:
        masks: The path of each image's mask, or None.
    """
    first = np.cumsum([0, *(lens.width * lens.height for lens in lenses)])
    pixels = np.empty((first[-1], 4), np.uint8)

    def read(index):
        lens = lenses[index]
        image = read_image(images[index], lens.width, lens.height, masks[index])
        pixels[first[index] : first[index + 1]] = image.reshape(-1, 4)

    with ThreadPoolExecutor(threads) as pool:
        for _ in track(pool.map(read, range(len(images))), len(images), "Loading images"):
            pass
    return pixels


def read_image(image: PosedImage, width: int, height: int, mask: Path | None = None) -> np.ndarray:
    """One image as its lens sees it, shrunk to that size, cut out by a mask.  [H, W, 4] uint8

    Raises:
        DatasetError: It can't be read.
    """
    try:
        with open_image(image.path) as file:
            turned = is_turned(image, file)
            pixels = rgba(file, upright=turned)
    except ImageError as error:
        raise DatasetError(str(error)) from None
    if pixels.size != (width, height):
        # A box filter is the mean over a pixel's area; Pillow weights RGBA by alpha for it.
        pixels = pixels.resize((width, height), Image.Resampling.BOX)
    if mask is None:
        return np.asarray(pixels)
    cut = np.array(pixels)
    cut[..., 3] = np.minimum(cut[..., 3], read_mask(mask, width, height, turned))
    return cut


def track(items: Iterable[Item], count: int, description: str) -> Iterable[Item]:
    """Yield the items under a progress bar on stderr, if that is a terminal."""
    from rich import progress
    from rich.console import Console

    console = Console(stderr=True)
    return progress.track(
        items,
        description,
        count,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
