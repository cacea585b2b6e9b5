"""transforms.json: NeRF-synthetic's, instant-ngp's and nerfstudio's.

The first has transforms_<split>.json with `camera_angle_x`, the horizontal field of view in
radians.  The other two may have one transforms.json for all, with fl_x, fl_y, cx, cy, w, h
in pixels and OpenCV's distortion k1, k2, k3, k4, p1, p2, for all frames or for each.  Each of
`frames` has a `file_path` (relative, its ending may be left out) and a `transform_matrix`.

Without a split of its own, every eighth view of a transforms.json is a test view; nerfstudio's
lists train_filenames, val_filenames and test_filenames are followed where they are.
"""

from pathlib import Path

import numpy as np

from ...render import Lens
from .capture import (
    EVERY_TEST_VIEW,
    IMAGE_ENDINGS,
    Capture,
    DatasetError,
    View,
    checked_lens,
    read_json,
    rigid_pose,
)

PERSPECTIVE = {None, "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"}
ASPECT_TOLERANCE = 0.02  # between the JSON's w : h and the image's


def transforms_path(folder, split) -> Path | None:
    """The file that lists a split's frames: its own, or the one of all where no split has one."""
    own, common = folder / f"transforms_{split}.json", folder / "transforms.json"
    if own.is_file():
        return own
    return common if common.is_file() and not (folder / "transforms_train.json").is_file() else None


def read(folder, split) -> Capture:
    """The views of a split.

    Raises:
        DatasetError: The file is not as it has to be, or no image is there.
    """
    path, scene, frames = listed(folder, split)
    views, missing = [], []
    for frame in frames:
        image = image_path(folder, frame["file_path"])
        if image is None:
            missing.append(frame["file_path"])
            continue
        pose = rigid_pose(
            frame.get("transform_matrix"), f"the transform_matrix of {frame['file_path']}"
        )
        views.append(View(image, pose, lens_reader({**scene, **frame}, path)))
    if not views:
        raise DatasetError(
            f"none of the {len(missing)} images that {path} names is there: {folder / missing[0]} "
            f"(tried as it is, and with {', '.join(IMAGE_ENDINGS)})"
            if missing
            else f"{path} has no {split} views"
        )
    return Capture(tuple(views), tuple(missing))


def has_split(folder, split) -> bool:
    """Whether a folder's file, of the split or of all, lists any of its frames."""
    return bool(listed(folder, split)[2])


def listed(folder, split):
    """A split's file, what is in it, and those of its frames that are the split's.

    Raises:
        DatasetError: The file is not as it has to be.
    """
    path = transforms_path(folder, split)
    scene = read_json(path)
    frames = scene.get("frames")
    if not isinstance(frames, list) or not frames:
        raise DatasetError(f"{path} lists no frames: there is nothing to load")
    for frame in frames:
        name = frame.get("file_path") if isinstance(frame, dict) else None
        if not isinstance(name, str) or not name:
            raise DatasetError(f"a frame of {path} has no file_path")
    if path.name == "transforms.json":
        frames = frames_of(scene, frames, split)
    return path, scene, frames


def frames_of(scene, frames, split):
    """The frames of a split, in the order of the file."""
    lists = {name: scene.get(f"{name}_filenames") for name in ("train", "val", "test")}
    if any(lists.values()):
        chosen = set(lists.get(split) or ())
        if split == "test" and not chosen:
            chosen = set(lists["val"] or ())
        return [frame for frame in frames if frame["file_path"] in chosen]
    order = sorted(range(len(frames)), key=lambda i: frames[i]["file_path"])
    aside = set(order[::EVERY_TEST_VIEW]) if len(frames) > 1 else set()
    return [frame for i, frame in enumerate(frames) if (i in aside) == (split != "train")]


def image_path(folder, name) -> Path | None:
    for ending in ("", *IMAGE_ENDINGS):
        path = folder / (name + ending)
        if path.is_file():
            return path
    return None


def lens_reader(values, path):
    """What makes a Lens of the numbers that hold for a frame, once the image's size is known."""
    model = values.get("camera_model")
    if model not in PERSPECTIVE or values.get("is_fisheye"):
        raise DatasetError(
            f"{path} has camera_model {model or 'fisheye'}, which is no perspective camera: "
            f"undistort the images first"
        )

    def number(key, otherwise=None):
        value = values.get(key, otherwise)
        if value is not None and not isinstance(value, int | float):
            raise DatasetError(f"{path} has {key} = {value!r}: it has to be a number")
        return value

    angle = number("camera_angle_x")
    if values.get("fl_x") is None and (angle is None or not 0.0 < angle < np.pi):
        raise DatasetError(
            f"{path} has no fl_x and camera_angle_x = {angle}: the latter has to be the "
            f"horizontal field of view in radians, between 0 and 3.14"
        )

    def lens(width, height):
        w, h = number("w", width), number("h", height)  # what the numbers are in pixels of
        if w <= 0 or h <= 0 or abs(np.log((w / h) / (width / height))) > ASPECT_TOLERANCE:
            raise DatasetError(
                f"{path} says that images have {w:g}x{h:g} pixels, but {values['file_path']} has "
                f"{width}x{height}: turned or cropped images need intrinsics of their own"
            )
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
