"""Data sets of images that a test makes."""

import numpy as np

from deformrf.core.training import Dataset


def from_images(images, poses, lenses, names, split, missing=(), bounds=None) -> Dataset:
    """A Dataset of images in memory, RGBA uint8 [H_i, W_i, 4] each."""
    pixels = np.concatenate([image.reshape(-1, 4) for image in images])
    return Dataset(
        pixels, np.asarray(poses), tuple(lenses), tuple(names), split, tuple(missing), bounds
    )
