"""Recognize the layout of a data set's folder, and list its images.

| layout | recognized by | read by |
|---|---|---|
| Blender, instant-ngp, nerfstudio | transforms_<split>.json, or transforms.json | transforms.py |
| NSVF (Tanks and Temples) | rgb/ and pose/ | nsvf.py |
| COLMAP | cameras or images in sparse/0/ and the like | colmap.py |
| Polycam, Record3D | keyframes/cameras/, metadata.json and rgb/ | phones.py |
"""

import os
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path

from . import colmap, nsvf, phones, transforms
from .errors import DatasetError, NoSplitError
from .photo_files import photo_folder
from .points import load_points
from .posed_images import Listing, PosedImage
from .turning import Turning

DEEPEST = 3  # folders that may be wrapped around a data set
MOST_FOLDERS = 1000  # that are looked into for one
WORK = ".capture"  # ending of the folders that hold unfinished work of wings/capture
READERS = nsvf, colmap, phones  # of folders without transforms.json, in the order of trying


def list_images(folder: Path, split: str | None, outside: bool = False) -> Listing:
    """What the layout's reader finds.

    Raises:
        DatasetError: The files are not as they have to be; or one of the images or of their masks
            lies outside the folder, and `outside` is False.
    """
    if not folder.is_dir():
        told = phones.archive_of(folder) if folder.is_file() else ""
        raise DatasetError(
            told or f"{folder} is not a folder: give the one that holds the data set"
        )
    listing, inner = read_layout(folder, split), folder.resolve()
    for image in () if outside else listing.images:
        for path in filter(None, (image.path, image.mask)):
            if not path.resolve().is_relative_to(inner):
                raise DatasetError(
                    f"{path} lies outside the data set's folder: copy it there, or allow this "
                    f"with --outside-images if you trust the data set"
                )
    turning = Turning(lambda: images_of_all_splits(folder, outside))
    return listing._replace(images=[replace(image, turning=turning) for image in listing.images])


def images_of_all_splits(folder, outside) -> list[PosedImage]:
    """The images of all splits whose files can be read; those inside the folder, or all."""
    images = []
    for split in ("train", "val", "test"):
        with suppress(DatasetError):
            images += read_layout(folder, split).images
    inner = folder.resolve()
    return [i for i in images if outside or i.path.resolve().is_relative_to(inner)]


def has_cameras(folder: Path) -> bool:
    """Whether a folder's files are in one of the layouts, for any split."""
    return any(folder.glob("transforms*.json")) or any(r.is_here(folder) for r in READERS)


def read_layout(folder, split):
    """What the reader of the folder's layout finds, wherever it lies."""
    if transforms.transforms_path(folder, split):
        return transforms.read(folder, split)
    if (folder / "transforms_train.json").is_file():
        return no_split(folder, split)  # another layout's cameras are in a space of their own
    for reader in READERS:
        if reader.is_here(folder):
            return reader.read(folder, split)
    check_place(folder)
    return no_split(folder, split)


def no_split(folder, split):
    """Raise the NoSplitError that names what is there."""
    others = ", ".join(sorted(p.name for p in folder.glob("transforms*.json"))) or "none"
    own = "transforms.json" if split is None else f"transforms_{split}.json"
    raise NoSplitError(
        f"{folder} holds no {own} (transforms files there: {others}), and "
        f"neither rgb/ and pose/ (NSVF) nor sparse/0/ (COLMAP) nor a scan (Polycam, Record3D) nor "
        f"cameras of photographs, which deformrf train finds"
    )


def check_place(folder: Path) -> None:
    """DatasetError, with what to do, if cameras lie deeper in a folder than they are read from."""
    inner = inner_data_sets(folder)
    if not inner:
        return
    names = ", ".join(str(path.relative_to(folder)) for path in inner[:4])
    if len(inner) > 1:
        raise DatasetError(
            f"{folder} has no cameras itself, but {len(inner)} folders in it have ({names}): give "
            f"one of them"
        )
    if not holds_photographs(inner[0]):
        models = colmap.sparse_folders(inner[0])
        place, right = (models[0], folder / "sparse/0") if models else (inner[0], folder)
        raise DatasetError(
            f"the cameras of {folder} lie in {place}, where they are not read: move that folder's "
            f"files to {right}"
        )
    raise DatasetError(f"{folder} has no cameras itself, but {inner[0]} has: give that folder")


def inner_data_sets(folder: Path) -> list[Path]:
    """The folders within a folder whose files have cameras, by name; none within another."""
    found = []
    for place, inner, _ in islice(os.walk(folder), MOST_FOLDERS):
        path = Path(place)
        is_found = path != folder and has_cameras(path)
        if is_found:
            found.append(path)
        if is_found or len(path.relative_to(folder).parts) == DEEPEST:
            inner.clear()
        inner[:] = sorted(name for name in inner if name[0] != "." and not name.endswith(WORK))
    return found


def holds_photographs(folder: Path) -> bool:
    try:
        return photo_folder(folder) is not None
    except DatasetError:  # several folders in it do
        return True


def sparse_points(folder, split):
    """Points that were found along with the cameras; None without any.  [n, 3]

    Raises:
        DatasetError: Their file is damaged.
    """
    if transforms.transforms_path(folder, split):
        try:
            sparse = load_points(folder)
        except ValueError as error:
            raise DatasetError(str(error)) from None
        return None if sparse is None else sparse.points
    if nsvf.is_here(folder) or not colmap.is_here(folder):
        return None
    return colmap.read_points(folder)
