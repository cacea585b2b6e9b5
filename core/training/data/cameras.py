"""The cameras of a data set, read without its images, for example for a film's path."""

from dataclasses import replace
from pathlib import Path

from ...render import Camera
from . import transforms
from .datasets import size_of
from .errors import DatasetError
from .foreign_paths import tail_of
from .layouts import list_images

SQUARE = 1000  # pixels of a side


def list_cameras(path: Path) -> tuple[list[Camera], list[str]]:
    """All cameras of a data set in the order of its files, with the lenses that training takes.

    An image need not exist if the files state its size, nor if they state its angle of view: it
    is square then.  None is read that lies outside the folder.

    Args:
        path: A transforms.json or the like, or the folder of a data set in any layout.

    Returns:
        The Camera of each image, in the data's space, with a lens in pixels of the image; and
        sentences about what was assumed.

    Raises:
        DatasetError: The files are not as they have to be.
    """
    said = []
    if path.is_dir():
        if file := transforms.transforms_path(path, None):
            return list_cameras(file)
        listing = list_images(path, None)
        images, folder = listing.images, path
        if listing.missing:
            said.append(
                f"{len(listing.missing)} of the cameras of {path.name} are left out, since their "
                f"images are missing, first {tail_of(listing.missing[0])}"
            )
        if not images:
            raise DatasetError(f"{path} has none of the images of its cameras")
    else:
        images, folder = transforms.cameras(path), path.parent
    inner, cameras, square = folder.resolve(), [], 0
    for image in images:
        if image.path and not image.path.resolve().is_relative_to(inner):
            image = replace(image, path=None)
        size = size_of(image) if image.path else image.stated_size
        if size is None:
            size, square = (SQUARE, SQUARE), square + 1
        cameras.append(Camera(image.camera_to_world, image.lens(*size)))
    if square:
        said.append(
            f"{path.name} states no width and height (w, h) of {square} of {len(images)} images "
            f"that are not there: they are taken for square"
        )
    return cameras, said
