"""Masks of photographs: images that say which pixels show the object.

The data set's files may name a photograph's mask (mask_path in transforms.json).  Otherwise it is
in the masks' folder, or in the photograph's subfolder there.  The mask of 0001.jpg is called
0001.png, 0001_mask.png, 0001-mask.png or 0001.jpg.png.

A mask is white on the object (opaque, if it has alpha).  Some programs write numbers or colors of
classes: if a mask has few values and none is white, the object is everything that is not black.
"""

from os.path import isfile
from pathlib import Path

import numpy as np
from PIL import Image, ImageChops

from ...base.images import ImageError, open_image, rgba
from .errors import DatasetError
from .foreign_paths import tail_of
from .photo_files import IMAGE_ENDINGS
from .posed_images import PosedImage, have_one_shape

UNTOLD = 1  # of 255, in a mask: nothing tells whether the pixel shows the object
MOST_CLASSES = 32  # values of a mask that holds numbers of classes; what is soft has more


def mask_paths(folder, images: list[PosedImage], needed=True) -> list[Path | None]:
    """The mask of each image; None without one, if they aren't `needed`.

    Raises:
        DatasetError: There is no such folder, an image has no mask although it needs one, or two
            images of one name in different folders have one mask.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DatasetError(f"--masks {folder} is not a folder: give the one that holds the masks")
    found = [mask_path(folder, image.path) for image in images]
    lacking = [image.path for image, mask in zip(images, found, strict=True) if not mask]
    owners = {}
    for image, mask in zip(images, found, strict=True):
        other = owners.setdefault(mask, image.path)
        if mask and other != image.path:
            raise DatasetError(
                f"{other} and {image.path} have one mask, {mask}: put masks into folders that are "
                f"called as the photographs' are"
            )
    if lacking and needed:
        first = lacking[0]
        raise DatasetError(
            f"{len(lacking)} of {len(images)} photographs have no mask in {folder}, first "
            f"{first.name} (tried {first.stem}.png, {first.stem}_mask.png, {first.name}.png and "
            f"the like): add them, or leave these photographs out"
        )
    return found


def named_masks(images: list[PosedImage], needed=True):
    """The masks that the data set's files name: one per image or None, and a sentence or none.

    DatasetError if some images have one, and others don't although they need one.
    """
    count, there = len(images), sum(image.mask is not None for image in images)
    if not there:
        said = "none of the masks that mask_path names is there: the photographs are used whole"
        return [None] * count, said if any(image.mask_name for image in images) else ""
    if there < count and needed:
        lacking = next(image for image in images if image.mask is None)
        name = tail_of(lacking.mask_name) or "none"
        raise DatasetError(
            f"{count - there} of {count} photographs have no mask, though mask_path names those of "
            f"others, first {lacking.path.name}, mask {name}: add them, give --masks, or take "
            f"mask_path out of all frames"
        )
    said = "the masks that mask_path names are used: white is the object, black is left out"
    return [image.mask for image in images], said


def mask_path(folder: Path, image: Path) -> Path | None:
    stems = (image.stem, f"{image.stem}_mask", f"{image.stem}-mask", image.name)
    endings = (*IMAGE_ENDINGS, *map(str.upper, IMAGE_ENDINGS))
    names = [stem + ending for stem in stems for ending in endings]
    places = [place for place in (folder / image.parent.name, folder) if place.is_dir()]
    paths = (place / name for place in places for name in names)
    return next((p for p in paths if isfile(p) and p.resolve() != image.resolve()), None)


def read_mask(path: Path, width, height, upright=False):
    """How much of each pixel is the object's, 0..255.  [H, W] uint8

    Args:
        width, height: Of the photograph as it is used; the mask is shrunk to that.
        upright: Turn it as its EXIF orientation says.

    Raises:
        DatasetError: It can't be read, or has another shape than the photograph.
    """
    try:
        with open_image(path) as file:
            pixels = rgba(file, upright)
    except ImageError as error:
        raise DatasetError(str(error)) from None
    if not have_one_shape(pixels.size, (width, height)):
        raise DatasetError(
            f"the mask {path} has {pixels.size[0]}x{pixels.size[1]} pixels, which is another shape "
            f"than its photograph's {width}x{height}"
        )
    alpha = pixels.getchannel("A")
    mask = without_classes(alpha if alpha.getextrema()[0] < 255 else brightest(pixels))
    shrunk = np.array(mask.resize((width, height), Image.Resampling.BOX))
    untold = mask.point(lambda value: 255 * (value == UNTOLD))
    shrunk[np.asarray(untold.resize((width, height), Image.Resampling.BOX)) > 0] = UNTOLD
    return shrunk


def without_classes(mask):
    """The same in Pillow's mode L, but white wherever it holds numbers of classes."""
    counts = mask.histogram()
    if counts[255] or np.count_nonzero(counts) > MOST_CLASSES:
        return mask
    return mask.point(lambda value: 255 * (value > 0))


def brightest(pixels):
    """The largest of red, green and blue: any full color is as far from black as white."""
    red, green, blue, _ = pixels.split()
    return ImageChops.lighter(ImageChops.lighter(red, green), blue)
