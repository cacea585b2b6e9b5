"""deformrf train --check: a page about the photographs and their cameras, instead of training."""

from pathlib import Path

import numpy as np
from PIL import Image

from ..core import training
from ..core.base.paths import whole_file
from ..core.base.streams import printable
from ..wings import capture
from .running import is_first, say_missing, say_once

SIDE = 480  # longer side that photographs are looked at [pixels]


def check(data: Path, output: Path, outside: bool = False) -> int:
    """Write MODEL-check.png for a data set whose cameras are known; returns the exit code.

    Args:
        output: The model that would be trained.
        outside: Read images that lie outside the data set's folder, too.

    Raises:
        DatasetError: Its files are not as they have to be.
    """
    if not is_first():
        return 0
    teaching = images_of(data, "train", outside)
    posed = {image.path: image for image in (*teaching, *images_of(data, "test", outside))}
    posed = [posed[path] for path in sorted(posed)]
    for image in posed:
        image.lens(*training.size_of(image))  # as training will: it raises an error for a bad one
    shown = [shown_of(image) for image in training.track(posed, len(posed), "Looking at images")]
    for line in dict.fromkeys(line for image in posed for line in image.turning.said()):
        say_once(line)  # a split has one
    known = {image.path.resolve() for image in posed}
    others, unreadable = capture.find_photos(posed[0].path.parent) if posed else ([], [])
    shown += [shown_alone(photo) for photo in others if photo.path.resolve() not in known]
    sparse = training.load_points(data)
    points = np.zeros((0, 3)) if sparse is None else sparse.points
    colors = np.zeros((0, 3), np.uint8) if sparse is None else sparse.colors
    corners = box_corners(teaching, points)  # as training will look for it
    title = f"{data.resolve().name}: {len(posed)} of {len(shown)} photographs with cameras, "
    title += f"{len(points)} points, " + ("no object found" if corners is None else "object found")
    doubts = capture.doubts_about(data) + doubts_about_directions(teaching)
    page = capture.page_of(printable(title), shown, points, colors, corners, doubts)
    path = output.with_name(f"{output.stem}-check.png")
    with whole_file(path) as partial:
        page.save(partial)
    for line in doubts + capture.judge(shown).sentences(shown) + unreadable[:1]:
        print(printable(line))
    print(f"Wrote {printable(path)}. Without --check the model is trained.")
    return 0


def images_of(data: Path, split: str, outside: bool):
    """The images of a split; none without such a split.  What the files leave open is said."""
    try:
        listing = training.list_images(data, split, outside)
        for line in listing.said:
            say_once(line)
        if split == "train":
            training.check_some(listing.images, listing.missing, split)
        say_missing(listing.missing, len(listing.images), split)
        return listing.images
    except training.NoSplitError:
        if split == "train":
            raise
        return []


def shown_of(image) -> capture.Shown:
    """A photograph with a camera."""
    width, height = training.shrunk_size(training.size_of(image), SIDE)
    rgba = training.read_image(image, width, height)
    white = np.round(255.0 * training.white_composite(rgba)).astype(np.uint8)
    return shown_as(image.path.name, white, image.camera_to_world)


def shown_alone(photo) -> capture.Shown:
    """A photograph without one."""
    try:
        rgb = capture.read_photo(photo, SIDE)
    except ValueError:  # damaged
        rgb = np.zeros((3, 4, 3), np.uint8)
    return shown_as(photo.path.name, rgb, None)


def shown_as(name: str, rgb, pose) -> capture.Shown:
    gray = training.gray_of(rgb)
    small = Image.fromarray(rgb)
    small.thumbnail(capture.THUMBNAIL)
    sharpness, exposure = training.sharpness_of(gray), training.exposure_of(gray)
    return capture.Shown(name, np.asarray(small), sharpness, exposure, pose)


def doubts_about_directions(posed) -> list[str]:
    """A sentence if the cameras look into one direction, as training will say then."""
    try:
        if posed:
            training.focus(np.array([image.camera_to_world for image in posed]))
    except training.DatasetError as error:
        return [str(error)]
    return []


def box_corners(posed, points):
    """Corners of the object's box, if it is found among the points; else None.  [8, 3]"""
    if len(points) == 0 or len(posed) < 2:
        return None
    poses = np.array([image.camera_to_world for image in posed])
    lenses = [image.lens(*training.size_of(image)) for image in posed]
    try:
        found = training.find_object(points, poses, lenses)
    except training.DatasetError:  # the cameras look into one direction
        return None
    if found is None:
        return None
    (x0, y0, z0), (x1, y1, z1) = found.box
    ring = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    corners = np.array([(x, y, z) for z in (z0, z1) for x, y in ring])
    return corners @ found.turn  # back: the turn's inverse is its transpose
