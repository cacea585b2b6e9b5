"""Photographs of gray from all sides, for tests of training steps."""

import numpy as np
from image_datasets import from_images

from deformrf.core.render import look_at, pinhole

GRAY = 128


def gray_photographs(alpha: int):
    """Four views of 8×8 pixels with that alpha, from random sides at distance 4.  Dataset"""
    image = np.full((8, 8, 4), (GRAY, GRAY, GRAY, alpha), np.uint8)
    eyes = np.random.default_rng().normal(size=(4, 3))
    poses = [look_at(4 * eye / np.linalg.norm(eye), (0, 0, 0)) for eye in eyes]
    return from_images([image] * 4, poses, [pinhole(12.0, 8, 8)] * 4, "abcd", "train")
