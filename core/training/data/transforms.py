"""transforms.json: NeRF-synthetic's, instant-ngp's and nerfstudio's.

NeRF-synthetic has transforms_<split>.json with `camera_angle_x`, the horizontal field of view in
radians.  The other two may have one transforms.json for all splits, with fl_x, fl_y, cx, cy, w, h
in pixels and OpenCV's distortion k1, k2, k3, k4, p1, p2, for all frames or for each.  Each of
`frames` has a `file_path` (see foreign_paths.py) and a `transform_matrix`, and optionally the
`mask_path` of a mask (masks.py).  wings/capture writes `upright: true`, which says that the cameras
are those of the images after EXIF rotation, and `ring`, the number of the place where the camera
stood still while the object turned.

If a transforms.json has no splits, every eighth of its images is a test image;
nerfstudio's lists train_filenames, val_filenames and test_filenames take precedence.
"""

from dataclasses import replace
from os.path import realpath
from pathlib import Path

import numpy as np

from ...base.streams import shown
from ...render import Lens
from .errors import DatasetError, NoSplitError
from .foreign_paths import as_it_is, find_files, key_of, tail_of
from .posed_images import (
    Listing,
    PosedImage,
    check_shape,
    checked_lens,
    is_of_split,
    json_of,
    rigid_pose,
)

MADE_BY = "deformrf-train"  # under the key made_by, if wings/capture wrote the file
MOST_RINGS = 10_000
PERSPECTIVE = {None, "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"}


def transforms_path(folder, split) -> Path | None:
    """The file of a split, or the common file if no split has a file of its own.

    Without a split, the common file, else that of the training images.
    """
    if split is None:
        names = "transforms.json", "transforms_train.json", "transforms_test.json"
        return next((folder / name for name in names if (folder / name).is_file()), None)
    own, common = folder / f"transforms_{split}.json", folder / "transforms.json"
    if own.is_file():
        return own
    return common if common.is_file() and not (folder / "transforms_train.json").is_file() else None


def read(folder, split) -> Listing:
    """The images of a split."""
    path = transforms_path(folder, split)
    scene, frames = scene_of(path)
    files = find_files(folder, [frame["file_path"] for frame in frames], path)
    chosen, said = list(range(len(frames))), [files.said, told_of_times(frames, path)]
    if path.name == "transforms.json":
        chosen, unknown = chosen_frames(scene, frames, files.paths, split, path)
        said.append(unknown)
    masks = masks_of(frames, path)
    said.append(masks.said)
    found, missing = [], []
    for i in chosen:
        if files.paths[i]:
            found.append(posed(scene, frames[i], files.paths[i], masks.paths[i], path))
        else:
            missing.append(frames[i]["file_path"])
    return Listing(found, missing, object_box(scene, path), tuple(filter(None, said)))


def object_box(scene, path):
    """The object's box, which wings/capture writes; None without one.  [2, 3]"""
    if "object_box" not in scene:
        return None
    try:
        box = np.array(scene["object_box"], float)
    except (TypeError, ValueError, OverflowError):
        box = np.zeros(0)
    if box.shape != (2, 3) or not np.isfinite(box).all():
        raise DatasetError(f"{path} has an object_box that is not two corners of three numbers")
    return box


def cameras(path: Path) -> list[PosedImage]:
    """All frames of a file in their order, whether their images exist or not.

    An image is sought only where no size is stated, nor follows from both angles of view.
    """
    scene, frames = scene_of(path, nameless=True)
    folder, found = path.parent, []
    for number, frame in enumerate(frames, start=1):
        name = frame.get("file_path")
        file = as_it_is(folder, name) if name else None
        image = posed(scene, {"file_path": f"frame {number}"} | frame, file, None, path)
        if file is None and image.stated_size is None:
            image = replace(image, stated_size=size_by_angles({**scene, **frame}))
        found.append(image)
    unsized = [
        i
        for i, image in enumerate(found)
        if not image.path and not image.stated_size and "file_path" in frames[i]
    ]
    files = find_files(folder, [frames[i]["file_path"] for i in unsized], path, once=False)
    for i, file in zip(unsized, files.paths, strict=True):
        found[i] = replace(found[i], path=file)
    return found


def size_by_angles(values):
    """Width and height of a picture with both angles of view of a frame; None without them."""
    angles = values.get("camera_angle_x"), values.get("camera_angle_y")
    is_known = all(isinstance(angle, float) and 0.0 < angle < np.pi for angle in angles)
    if not is_known or values.get("fl_x") is not None:
        return None
    return tuple(1000.0 * np.tan(0.5 * angle) for angle in angles)


def scene_of(path, nameless=False):
    """What a file says, and its frames, each of which has a file_path unless they may lack it."""
    scene = json_of(path)
    frames = scene.get("frames") if isinstance(scene, dict) else None
    if not isinstance(frames, list) or not frames:
        kind = NoSplitError if frames == [] else DatasetError
        raise kind(f"{path} lists no frames: there is nothing to load")
    for frame in frames:
        name = frame.get("file_path") if isinstance(frame, dict) else None
        lacks = nameless and isinstance(frame, dict) and "file_path" not in frame
        if not lacks and (not isinstance(name, str) or not name):
            raise DatasetError(f"a frame of {path} has no file_path")
    return scene, frames


def posed(scene, frame, image, mask, path) -> PosedImage:
    """A frame's image, or None, with its camera."""
    name = frame["file_path"]
    pose = rigid_pose(frame.get("transform_matrix"), f"the transform_matrix of {name}")
    values = {**scene, **frame}
    size = values.get("w"), values.get("h")
    stated = size if all(isinstance(side, float) for side in size) else None
    upright = frame.get("upright") is True
    lens = lens_reader(values, path)
    mask_name = frame.get("mask_path") or ""
    ring = ring_of(frame, path) if scene.get("made_by") == MADE_BY else -1
    return PosedImage(image, pose, lens, stated, upright, mask=mask, mask_name=mask_name, ring=ring)


def ring_of(frame, path) -> int:
    """The number of a frame's ring, which wings/capture writes; -1 without one."""
    ring = frame.get("ring")
    if ring is None:
        return -1
    if not isinstance(ring, float) or not 0.0 <= ring < MOST_RINGS or ring % 1.0:
        raise DatasetError(f"{path} has ring = {shown(ring)}: it has to be a whole number")
    return int(ring)


def masks_of(frames, path):
    """The masks that frames name, as find_files has them; a frame without one has None."""
    names = [frame.get("mask_path") or "" for frame in frames]
    for name in names:
        if not isinstance(name, str):
            raise DatasetError(f"{path} has mask_path = {shown(name)}: it has to be a name")
    named = [i for i, name in enumerate(names) if name]
    found = find_files(path.parent, [names[i] for i in named], path)
    paths = dict(zip(named, found.paths, strict=True))
    return replace(found, paths=[paths.get(i) for i in range(len(frames))])


def chosen_frames(scene, frames, files, split, path):
    """The places of a split's frames in the file, in its order, and a sentence or none.

    Args:
        files: The frames' images, or None.
        path: The file's.
    """
    lists = {name: scene.get(f"{name}_filenames") for name in ("train", "val", "test")}
    for name, names in lists.items():
        is_list = isinstance(names, list) and all(isinstance(entry, str) for entry in names)
        if names is not None and not is_list:
            raise DatasetError(
                f"{path} has {name}_filenames = {shown(names)}: it has to be a list of names"
            )
    if any(lists.values()) and split is not None:
        key = "val" if split == "test" and not lists["test"] else split
        return listed_frames(lists.get(key) or [], f"{key}_filenames", frames, files, path)
    order = sorted(range(len(frames)), key=lambda i: frames[i]["file_path"])
    chosen = [i for place, i in enumerate(order) if is_of_split(place, len(order), split)]
    return sorted(chosen), ""


def listed_frames(names, key, frames, files, path):
    """The same for a list of names: they are compared as paths, and by the files they mean."""
    meant = find_files(path.parent, names, path, once=False).paths
    entries = {key_of(name) for name in names} | {*map(realpath, filter(None, meant))}
    own = [
        {key_of(frame["file_path"])} | ({realpath(file)} if file else set())
        for frame, file in zip(frames, files, strict=True)
    ]
    known = set().union(*own)
    unknown = [
        name
        for name, file in zip(names, meant, strict=True)
        if key_of(name) not in known and not (file and realpath(file) in known)
    ]
    said = f"{len(unknown)} of {len(names)} {key} in {path.name} name no frame"
    chosen = [i for i, its in enumerate(own) if its & entries]
    return chosen, f"{said}, first {tail_of(unknown[0])}" if unknown else ""


def told_of_times(frames, path) -> str:
    """A sentence if frames show different times, which one still object can't."""
    times = {time for f in frames if isinstance(time := f.get("time"), float) and time == time}
    if len(times) < 2:
        return ""
    return (
        f"the frames of {path.name} show {len(times)} different times, and one still object is "
        f"trained of all of them: if it moves, keep the frames of one time"
    )


def check_center(center, values, size, path):
    """DatasetError if cx and cy can't be of an image of this size, and no other one is stated."""
    for key, side, place, length in zip(("cx", "cy"), ("w", "h"), center, size, strict=True):
        if values.get(side) is None and not 0.25 < place / length < 0.75:
            raise DatasetError(
                f"{path} has {key} = {place:g} and no {side}, and {values['file_path']} has "
                f"{size[0]}x{size[1]} pixels: add the w and h of the images that its numbers are "
                f"for"
            )


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
        if not isinstance(value, float):
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
        center = number("cx", 0.5 * w), number("cy", 0.5 * h)
        check_center(center, values, (width, height), path)
        whole = Lens(
            w,
            h,
            (float(focal_x), float(focal_y)),
            (float(center[0]), float(center[1])),
            tuple(float(number(key, 0.0)) for key in ("k1", "k2", "k3", "k4")),
            tuple(float(number(key, 0.0)) for key in ("p1", "p2")),
        )
        return checked_lens(whole.resized(width, height), f"{path}, {values['file_path']}")

    return lens
