"""transforms.json: NeRF-synthetic's, instant-ngp's and nerfstudio's.

NeRF-synthetic has transforms_<split>.json with `camera_angle_x`, the horizontal field of view in
radians.  The other two may have one transforms.json for all, with fl_x, fl_y, cx, cy, w, h
in pixels and OpenCV's distortion k1, k2, k3, k4, p1, p2, for all frames or for each.  Each of
`frames` has a `file_path` (relative, its ending may be left out) and a `transform_matrix`;
`upright: true`, which core/capture writes, says that they are those of the image as its EXIF
orientation turns it.

Without a split of its own, every eighth image of a transforms.json is a test image;
nerfstudio's lists train_filenames, val_filenames and test_filenames take precedence.
"""

import json
from pathlib import Path

import numpy as np

from ...render import Lens
from .posed_images import (
    IMAGE_ENDINGS,
    DatasetError,
    NoSplitError,
    PosedImage,
    check_shape,
    checked_lens,
    existing,
    is_of_split,
    rigid_pose,
    text_of,
)

PERSPECTIVE = {None, "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"}


def transforms_path(folder, split) -> Path | None:
    """The file of a split, or the common file if no split has a file of its own."""
    own, common = folder / f"transforms_{split}.json", folder / "transforms.json"
    if own.is_file():
        return own
    return common if common.is_file() and not (folder / "transforms_train.json").is_file() else None


def read(folder, split):
    """The images of a split, those missing, no box."""
    path = transforms_path(folder, split)
    try:
        # As floats, too large integers are infinite, and no number is read digit by digit.
        scene = json.loads(text_of(path), parse_int=float)
    except DatasetError:
        raise
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path} is not JSON: {error}") from None
    frames = scene.get("frames") if isinstance(scene, dict) else None
    if not isinstance(frames, list) or not frames:
        kind = NoSplitError if frames == [] else DatasetError
        raise kind(f"{path} lists no frames: there is nothing to load")
    for frame in frames:
        name = frame.get("file_path") if isinstance(frame, dict) else None
        if not isinstance(name, str) or not name:
            raise DatasetError(f"a frame of {path} has no file_path")
    if path.name == "transforms.json":
        frames = frames_of(scene, frames, split, path)
    found, missing = [], []
    for frame in frames:
        name = frame["file_path"]
        if image := image_path(folder, name):
            pose = rigid_pose(frame.get("transform_matrix"), f"the transform_matrix of {name}")
            values = {**scene, **frame}
            lens, size = lens_reader(values, path), (values.get("w"), values.get("h"))
            stated = size if all(map(is_number, size)) else None
            found.append(PosedImage(image, pose, lens, stated, frame.get("upright") is True))
        else:
            missing.append(name)
    return found, missing, None


def frames_of(scene, frames, split, path):
    """The frames of a split, in the order of the file, whose path is for messages."""
    lists = {name: scene.get(f"{name}_filenames") for name in ("train", "val", "test")}
    for name, names in lists.items():
        is_list = isinstance(names, list) and all(isinstance(entry, str) for entry in names)
        if names is not None and not is_list:
            raise DatasetError(
                f"{path} has {name}_filenames = {shown(names)}: it has to be a list of names"
            )
    if any(lists.values()):
        chosen = set(lists.get(split) or ())
        if split == "test" and not chosen:
            chosen = set(lists["val"] or ())
        return [frame for frame in frames if frame["file_path"] in chosen]
    order = sorted(range(len(frames)), key=lambda i: frames[i]["file_path"])
    chosen = {i for place, i in enumerate(order) if is_of_split(place, len(order), split)}
    return [frame for i, frame in enumerate(frames) if i in chosen]


def image_path(folder, name) -> Path | None:
    return next(filter(None, (existing(folder, name + e) for e in ("", *IMAGE_ENDINGS))), None)


def shown(value) -> str:
    """A value of a JSON file, for a message."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."


def is_number(value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def lens_reader(values, path):
    """The function that makes an image's lens from its width and height on disk.

    Args:
        values: The JSON's numbers for the frame.
        path: Path of the JSON, for messages.
    """
    model = values.get("camera_model")
    is_known = model is None or (isinstance(model, str) and model in PERSPECTIVE)
    if not is_known or values.get("is_fisheye"):
        kind = "fisheye" if is_known else shown(model)
        raise DatasetError(
            f"{path} has camera_model {kind}, which is no perspective camera: "
            f"undistort the images first"
        )

    def number(key, otherwise=None):
        value = values.get(key)
        if value is None:
            return otherwise
        if not is_number(value):
            raise DatasetError(f"{path} has {key} = {shown(value)}: it has to be a number")
        return value

    angle = number("camera_angle_x")
    if values.get("fl_x") is None and (angle is None or not 0.0 < angle < np.pi):
        raise DatasetError(
            f"{path} has no fl_x and camera_angle_x = {angle}: the latter has to be the "
            f"horizontal field of view in radians, between 0 and 3.14"
        )

    def lens(width, height):
        # Of the images that the numbers are for.
        w, h = number("w", width), number("h", height)
        check_shape((width, height), (w, h), values["file_path"], path)
        focal_x = number("fl_x")
        if focal_x is None:
            focal_x = 0.5 * w / np.tan(0.5 * angle)
        focal_y = number("fl_y", focal_x)
        whole = Lens(
            w,
            h,
            (float(focal_x), float(focal_y)),
            (float(number("cx", 0.5 * w)), float(number("cy", 0.5 * h))),
            tuple(float(number(key, 0.0)) for key in ("k1", "k2", "k3", "k4")),
            tuple(float(number(key, 0.0)) for key in ("p1", "p2")),
        )
        return checked_lens(whole.resized(width, height), f"{path}, {values['file_path']}")

    return lens
