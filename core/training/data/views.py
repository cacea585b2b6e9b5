"""What all cameras of a data set share: the point that they look at, and what is up."""

import numpy as np

from ... import capture
from .posed_images import DatasetError


def focus(poses):
    """The point nearest to all cameras' axes by squared distance.  [3]

    Raises:
        DatasetError: The axes are parallel, or most cameras look away from the point.
    """
    point = capture.focus(poses)
    if point is None:
        raise DatasetError(
            "the cameras look into about the same direction, so the place of the object is "
            "unknown: give its box with --aabb x0 y0 z0 x1 y1 z1 in the data's units"
        )
    depths = ((point - poses[:, :3, 3]) * -poses[:, :3, 2]).sum(axis=1)
    if np.mean(depths < 0.0) > 0.5:
        raise DatasetError(
            "most cameras look away from the place where their axes meet: matrices with OpenCV's "
            "axes (y down, z forward) need their second and third column negated, and cameras that "
            "look out from one place the object's box, --aabb x0 y0 z0 x1 y1 z1"
        )
    return point


def common_up(poses):
    """The mean of the cameras' up directions, a unit vector.  [3]"""
    up = poses[:, :3, 1].mean(axis=0)
    return up / max(np.linalg.norm(up), 1e-12)
