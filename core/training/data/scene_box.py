"""Choose the region of the world that becomes the unit cube, in which the tets are.

The object's box is the first of these that exists: the user's (`--aabb`, or `--scene-radius` around
the data's origin); the data set's (NSVF's bbox.txt); the one found in photographs with surroundings
(found_object.py); a box around the point that the cameras look at.  The cube's edge is the
box's longest side.  Tets outside the user's box or the found one are removed, so the model has
no tets for things beside the object.
"""

import numpy as np
from numpy.typing import ArrayLike

from .datasets import Dataset
from .errors import DatasetError
from .found_object import FoundObject
from .posed_images import FARTHEST
from .views import focus

# Half an edge over the cameras' median distance: NeRF-synthetic's cameras stand 4.03 from
# the center of the box from -1.5 to 1.5, and instant-ngp scales captures to about the same.
REACH = 1.5 / 4.031
WHITE, WHITE_SHARE = 250, 0.8  # of 255; of the border


def world_to_unit_cube(
    dataset: Dataset, aabb: ArrayLike | None = None, radius: float | None = None
) -> np.ndarray:
    """The similarity from the data's space to model space.  [4, 4]

    Args:
        aabb, radius: The user's; see TrainOptions.

    Raises:
        DatasetError: The box is empty, or the cameras don't look at one place.
    """
    if aabb is not None:
        return box_to_unit_cube(np.reshape(aabb, (2, 3)), "--aabb")
    if radius is not None:
        return box_to_unit_cube(np.full((2, 3), radius) * [[-1], [1]], "--scene-radius")
    if dataset.bounds is not None:
        return box_to_unit_cube(dataset.bounds, "the data set's box")
    center = focus(dataset.poses)
    distances = np.linalg.norm(dataset.poses[:, :3, 3] - center, axis=1)
    half = REACH * np.median(distances)
    return box_to_unit_cube([center - half, center + half], "the box that the cameras look at")


def object_box(world_to_model, aabb=None):
    """The object's box in model space: the unit cube, or what of it `aabb` is.  [2, 3]"""
    if aabb is None:
        return np.array([[0.0] * 3, [1.0] * 3])
    corners = np.reshape(aabb, (2, 3))
    return corners * np.diag(world_to_model)[:3] + world_to_model[:3, 3]


def found_to_unit_cube(found: FoundObject):
    """The similarity that puts a found object upright into the unit cube, and its box there.

    The box stands on z = 0, in the middle of x and y.  [4, 4], [2, 3]
    """
    low, high = found.box
    scale = 1.0 / (high - low).max()
    foot = np.array([*(0.5 * (low + high)[:2]), low[2]])
    matrix = np.eye(4)
    matrix[:3, :3] = scale * found.turn
    matrix[:3, 3] = [0.5, 0.5, 0.0] - scale * foot
    return matrix, scale * (found.box - foot) + [0.5, 0.5, 0.0]


def seeks_object(dataset: Dataset, options) -> bool:
    """Whether nothing says where the object is, by TrainOptions, and photographs may show it."""
    is_given = options.aabb is not None or options.scene_radius is not None
    if is_given or dataset.bounds is not None or "found-box" in options.leave_out:
        return False
    return are_photographs(dataset, options)


def are_photographs(dataset: Dataset, options) -> bool:
    """Whether the images show an object in its surroundings, by TrainOptions."""
    return dataset.masked or learns_surroundings(options.surroundings, dataset)


def learns_surroundings(choice: str, dataset: Dataset) -> bool:
    """Whether surroundings are learned from these images, by TrainOptions.surroundings."""
    if choice == "auto":
        return not dataset.has_alpha and not has_white_border(dataset)
    return choice == "learnt"


def has_white_border(dataset: Dataset) -> bool:
    """Whether the images' outermost pixels are white, as where an object is cut out on white."""
    white = total = 0
    for view in range(dataset.view_count):
        image = dataset.image(view)[..., :3]
        border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
        white += int((border >= WHITE).all(axis=1).sum())
        total += len(border)
    return white > WHITE_SHARE * total


def box_to_unit_cube(box, name):
    """The similarity from a box [2, 3] to the unit cube; `name` is for the message.  [4, 4]"""
    low, high = np.asarray(box, float)
    is_sane = (np.abs(box) <= FARTHEST).all() and (high > low).all()
    if not is_sane or (high - low).max() < 1.0 / FARTHEST:
        raise DatasetError(
            f"{name} has to be x0 y0 z0 x1 y1 z1 with each of the first three smaller than its "
            f"counterpart, up to {FARTHEST:g}; it is {' '.join(f'{v:g}' for v in (*low, *high))}"
        )
    size = high - low
    matrix = np.eye(4) / size.max()
    matrix[:3, 3] = 0.5 - 0.5 * (low + high) / size.max()
    matrix[3, 3] = 1.0
    return matrix
