"""What all cameras of a data set share: the point that they look at, and what is up."""

import numpy as np

from ... import capture
from .posed_images import DatasetError

BOX = "--aabb x0 y0 z0 x1 y1 z1"
INVERTED = "world-to-camera matrices have to be inverted"
AIMED = 0.8  # mean cosine between a camera's axis and its way to the object: 37°, at an image's rim


def focus(poses):
    """The point nearest to all cameras' axes by squared distance.  [3]

    Raises:
        DatasetError: The axes are parallel, or most cameras look elsewhere.
    """
    point = capture.focus(poses)
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
