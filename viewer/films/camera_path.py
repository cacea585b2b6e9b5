"""Camera paths: files that say where a film's camera is at which time.

Our own format is JSON, {"keys": [...]} with a key for each time [s].  A key has a place and what
it looks at, or the camera's matrix in OpenGL's axes, both in model space:

    {"t": 0.0, "position": [1.5, -2.0, 1.0], "target": [0.5, 0.5, 0.5], "fov": 35}
    {"t": 2.0, "transform_matrix": [[...], [...], [...], [0, 0, 0, 1]], "fov": 35}

`fov` is the vertical field of view [degrees].  The camera goes through all keys on a smooth curve
(keys.orbit_at).  The cameras of a data set are those that training takes, with their lenses
(sight.py).  docs/camera-path.md has it all, with the files of other programs that are read.
"""

import json
import logging
import math
from pathlib import Path

import numpy as np

from ...core.base import schema
from ...core.base.reading import read_text
from ...core.base.streams import printable, shown
from ...core.render import in_space, look_at
from ..camera import Orbit, looking_from
from ..document import TICKS_PER_SECOND, CameraKey
from .sight import fit, sight_of

MOST_KEYS = 10_000
LONGEST = 3600.0  # s
FARTHEST_POINT = 1e4
APART = 1.0  # s between two keys that have no time
FIELDS_OF_VIEW = 0.1, 170.0  # degrees
INTRINSICS = "fl_x", "camera_angle_x"  # without which training takes no data set
NOT_RIGID = 1e-3  # by how much the axes of a matrix may miss being perpendicular
log = logging.getLogger(__name__)


class CameraPathError(ValueError):
    """A file is no camera path; the message is one sentence."""


def load_camera_path(path: Path, world_to_model, center, size=None) -> tuple[CameraKey, ...]:
    """Read and check a camera path; ticks are counted from its first key on.

    Args:
        path: A file, or the folder of a data set.
        world_to_model: From the space of the training data, in which files of other programs
            have their cameras.  [4, 4]
        center: Of the object: what a camera without a target is taken to turn about.  [3]
        size: Width and height of the film; without it, that of each photograph.

    Raises:
        CameraPathError: The file is none.
        OSError: It can't be read.
    """
    path, orbits = Path(path), None
    read = {"frames": []} if path.is_dir() else _read(path)
    if path.is_dir() or _is_data_set(read):
        orbits = _photographed(path, world_to_model, center, size)
        keys, matrix, shared = read["frames"] or [{}] * len(orbits), None, {"apart": APART}
    else:
        keys, matrix, shared = _entries(path, read, world_to_model)
    if not isinstance(keys, list) or not 2 <= len(keys) <= MOST_KEYS:
        raise CameraPathError(f"{path}: a camera path has 2 to {MOST_KEYS:,} keys")
    found, seconds = [], -shared["apart"]
    for number, key in enumerate(keys, start=1):
        place = f"{path}, key {number}"
        if not isinstance(key, dict):
            raise CameraPathError(f"{place} is not in braces")
        before, seconds = seconds, _number(place, key, "t", seconds + shared["apart"], LONGEST)
        if seconds <= before and found:
            raise CameraPathError(f"{place} is at {seconds:g} s, not after the one before")
        own = orbits[number - 1] if orbits else _orbit(place, shared | key, matrix, center)
        found.append((seconds, own))
    start = found[0][0]
    return tuple(CameraKey((t - start) * TICKS_PER_SECOND, o, "linear") for t, o in found)


def _read(path):
    try:
        return json.loads(read_text(path), parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise CameraPathError(f"{path} is no camera path: it is not JSON") from error


def _is_data_set(read) -> bool:
    """Whether a file has the cameras of a data set, with their intrinsics."""
    frames = read.get("frames") if isinstance(read, dict) and "keys" not in read else None
    if not isinstance(frames, list):
        return False
    own = (frame for frame in frames if isinstance(frame, dict))
    return any(values.get(name) is not None for values in (read, *own) for name in INTRINSICS)


def _photographed(path, world_to_model, center, size):
    from ...core.training import DatasetError, list_cameras

    try:
        cameras, said = list_cameras(path)
    except DatasetError as error:
        raise CameraPathError(printable(str(error))) from None
    sights = []
    for number, camera in enumerate(cameras, start=1):
        pose = in_space(camera.camera_to_world, world_to_model)
        _check_near(pose, f"{path}, camera {number}", "data set of this model")
        sights.append(sight_of(looking_from(Orbit(), pose, center), camera.lens))
    sights, told = fit(sights, size)
    for sentence in filter(None, (*said, told)):
        log.warning(printable(sentence))
    return sights


def _entries(path, read, world_to_model):
    """The keys of a file, what takes them to model space [4, 4], and what all of them share."""
    read = {"keys": read} if isinstance(read, list) else read
    if not isinstance(read, dict):
        raise CameraPathError(f"{path} is no camera path: it has no keys")
    if "keys" in read:
        return read["keys"], np.eye(4), {"apart": APART}
    if "camera_path" in read:  # nerfstudio's
        _check_nerfstudio(path, read)
        fps = _number(path, read, "fps", 24.0, 1000.0, 0.1)
        return read["camera_path"], world_to_model, {"apart": 1.0 / fps}
    if "frames" in read:  # of Blender's, instant-ngp's and nerfstudio's data sets
        return read["frames"], world_to_model, {"apart": APART, **_view_of(path, read)}
    raise CameraPathError(f"{path} is no camera path: it has no keys, frames or camera_path")


def _check_nerfstudio(path, read):
    """CameraPathError if a path is of no pinhole's pictures."""
    kind = read.get("camera_type") or "perspective"
    if kind != "perspective":
        raise CameraPathError(
            f"{path} has camera_type {kind!r}"[:200] + ": only 'perspective' can be filmed, "
            "change it there if you want that"
        )
    fits = "%s fits if nerfstudio trained without centering and scaling the scene, "
    log.warning(fits + "which it does unless it is switched off", printable(path.name))


def _view_of(path, read):
    """The field of view that a data set's cameras share, if it says one."""
    if "camera_angle_y" in read:
        return {"fov": math.degrees(_number(path, read, "camera_angle_y", 1.0, math.pi, 0.0))}
    if "fl_y" in read and "h" in read:
        height = _number(path, read, "h", 1.0, 1e6, 1.0)
        focal = _number(path, read, "fl_y", 1.0, 1e7, 1e-3)
        return {"fov": math.degrees(2 * math.atan(0.5 * height / focal))}
    return {}


def _orbit(place, key, matrix, center) -> Orbit:
    fov = _number(place, key, "fov", math.degrees(Orbit().field_of_view), *FIELDS_OF_VIEW[::-1])
    if "position" in key:
        center = _point(place, key, "target") if "target" in key else np.asarray(center, float)
        at = _point(place, key, "position")
        up = _point(place, key, "up") if "up" in key else np.array([0.0, 0.0, 1.0])
        forward = center - at
        if np.linalg.norm(np.cross(forward, up)) < 1e-9 * max(np.linalg.norm(forward), 1e-9):
            if not forward.any() or "up" in key:
                raise CameraPathError(f"{place} looks nowhere, or along what is up")
            up = np.array([0.0, 1.0, 0.0])  # straight down, or up
        pose = look_at(at, center, up)
    else:
        pose = _pose(place, key.get("transform_matrix", key.get("camera_to_world")))
        pose = in_space(pose, matrix)
        _check_near(pose, place, "space of this model's training data")
    return looking_from(Orbit(field_of_view=math.radians(fov)), pose, center)


def _check_near(pose, place, what):
    """CameraPathError if a camera is so far away that it is not of this model."""
    away = abs(pose[:3, 3]).max()
    if away > FARTHEST_POINT:
        raise CameraPathError(f"{place} is {away:.3g} model sizes away: is this the {what}?")


def _pose(place, matrix):
    """A camera's matrix [4, 4]; rows may be in one list, and their last one may be missing."""
    try:
        pose = np.array(matrix, float).reshape(-1, 4)
    except (TypeError, ValueError, OverflowError) as error:
        message = f"{place} needs a position, or a transform_matrix of 4 × 4 numbers"
        raise CameraPathError(message) from error
    good = pose.shape in ((3, 4), (4, 4)) and np.isfinite(pose).all()
    good = good and (len(pose) == 3 or np.abs(pose[3, :3]).max() < 1e-4)  # else it is transposed
    if good:
        axes = pose[:3, :3] / np.maximum(np.linalg.norm(pose[:3, :3], axis=0), 1e-12)
        good = abs(axes.T @ axes - np.eye(3)).max() < NOT_RIGID and np.linalg.det(axes) > 0.0
    if not good:
        raise CameraPathError(f"{place} has a matrix that is not a rotation and a position")
    return np.block([[axes, pose[:3, 3:]], [np.zeros((1, 3)), np.ones((1, 1))]])


def _number(place, key, name, default, high, low=0.0):
    value = key.get(name, default)
    if not schema.number(low, high)(value):
        said = f"{place} has {name} = {shown(value)}"
        raise CameraPathError(f"{said}; {low:g} to {high:g} are possible")
    return float(value)


def _point(place, key, name):
    value = key[name]
    if not schema.vector(3, schema.number(-FARTHEST_POINT, FARTHEST_POINT))(value):
        raise CameraPathError(f"{place} has {name} = {shown(value)}; it has to be [x, y, z]")
    return np.array(value, float)


def _refuse(name):
    raise ValueError(name)
