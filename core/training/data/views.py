"""What a data set's cameras have in common: the point that they look at, and the up direction."""

import numpy as np
from numpy.typing import ArrayLike

from .errors import DatasetError

BOX = "--aabb x0 y0 z0 x1 y1 z1"
INVERTED = "world-to-camera matrices have to be inverted"
AIMED = 0.8  # mean cosine between a camera's axis and its way to the object: 37°, at an image's rim
PARALLEL = 0.02  # below this smallest eigenvalue of the mean projector views have no focus
# Mean squares of how far images' rows point along up, and along the direction that they do less
# than the other: cameras held level within 10°, and swung by more than 40°.
HELD, SWUNG = 0.03, 0.04
STEEP = 70.0  # degrees up or down, from which a photograph is not taken from a side
AROUND = 180.0  # degrees that views see at least, if they are taken to go around


def nearest_to_axes(poses: np.ndarray) -> np.ndarray | None:
    """The point nearest to all cameras' axes by squared distance; None if these are parallel.  [3]

    Args:
        poses: Camera to world, OpenGL's axes.  [n, 4, 4]
    """
    origins, axes = poses[:, :3, 3], poses[:, :3, 2]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # projectors across each axis
    mean = across.mean(axis=0)
    if np.linalg.eigvalsh(mean)[0] < PARALLEL:
        return None
    return np.linalg.solve(mean, np.einsum("nij,nj->i", across, origins) / len(poses))


def focus(poses: np.ndarray) -> np.ndarray:
    """The point nearest to all cameras' axes by squared distance.  [3]

    Raises:
        DatasetError: The axes are parallel, or most cameras look elsewhere.
    """
    point = nearest_to_axes(poses)
    if point is None:
        raise DatasetError(
            "the cameras look into about the same direction, so the place of the object is "
            f"unknown: give its box with {BOX} in the data's units; {INVERTED}"
        )
    offsets = point - poses[:, :3, 3]
    distances = np.maximum(np.linalg.norm(offsets, axis=1), 1e-12)
    if np.mean((offsets * -poses[:, :3, 2]).sum(axis=1) / distances) < AIMED:
        raise DatasetError(
            "the cameras don't look at the place where their axes meet: matrices with OpenCV's "
            f"axes (y down, z forward) need their second and third column negated, {INVERTED}, and "
            f"cameras that look out from one place need the object's box, {BOX}"
        )
    return point


def common_up(poses):
    """The mean of the cameras' up directions, a unit vector.  [3]"""
    up = poses[:, :3, 1].mean(axis=0)
    return up / max(np.linalg.norm(up), 1e-12)


def up_of(poses: np.ndarray) -> np.ndarray:
    """The direction that is across all images' rows, or the cameras' mean up.  [3]

    Whoever looks down from one side holds the camera level, while its up direction leans.
    """
    mean = common_up(poses)
    rows = poses[:, :3, 0]
    parts, axes = np.linalg.eigh(rows.T @ rows / len(rows))
    across = axes[:, 0] * np.sign(axes[:, 0] @ mean)
    is_clear = parts[0] < HELD < SWUNG < parts[1] and across @ mean > np.cos(np.radians(STEEP))
    return across if is_clear else mean


def offsets_from(center: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """From a point to cameras.  [3], [n, 4, 4] -> [n, 3]"""
    return np.asarray(poses, float).reshape(-1, 4, 4)[:, :3, 3] - center


def directions_from(center: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """From a point to cameras, unit vectors.  [3], [n, 4, 4] -> [n, 3]"""
    offsets = offsets_from(center, poses)
    return offsets / np.maximum(np.linalg.norm(offsets, axis=1, keepdims=True), 1e-12)


def angles_to_nearest(directions: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Degrees from each direction to the nearest that is seen.  [..., 3], [n, 3] -> [...]"""
    return np.degrees(np.arccos(np.clip((directions @ seen.T).max(axis=-1), -1.0, 1.0)))


def widest_step(azimuths) -> float:
    """Degrees around without a view, at most."""
    order = np.sort(azimuths)
    return float(np.diff(order, append=order[0] + 360.0).max())


def upright(up: ArrayLike) -> np.ndarray:
    """The smallest rotation that takes a direction to +z.  [3, 3]"""
    up = np.asarray(up, float) / max(np.linalg.norm(up), 1e-12)
    z = np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(up, z), up @ z
    if cosine < -0.999999:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + cosine)
