"""What a data set's cameras have in common: the point that they look at, and the up direction."""

import numpy as np
from numpy.typing import ArrayLike

from .errors import DatasetError

BOX = "--aabb x0 y0 z0 x1 y1 z1"
INVERTED = "world-to-camera matrices have to be inverted"
AIMED = 0.8  # mean cosine between a camera's axis and its way to the object: 37°, at an image's rim
PARALLEL = 0.02  # below this smallest eigenvalue of the mean projector views have no focus


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


def upright(up: ArrayLike) -> np.ndarray:
    """The smallest rotation that takes a direction to +z.  [3, 3]"""
    up = np.asarray(up, float) / max(np.linalg.norm(up), 1e-12)
    z = np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(up, z), up @ z
    if cosine < -0.999999:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + cosine)
