"""How sharp and how bright a photograph is."""

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

SIDE = 480  # longer side that images are compared at [pixels]
RAMP = 0.5  # sharpness of an image without detail at the fine scale
LEAST_STRENGTH = 0.1  # gray levels: a direction with less has no texture to be judged by
OUTLIER = 3.0  # standard deviations below the mean, from which a photograph is blurred
QUARTER, EIGHTH = 0.674, 1.150  # of a normal distribution, in deviations above its mean
LEAST_DEVIATION = 0.02  # of the sharpness
LEAST_WEIGHT = 0.1  # of a photograph: it may be the only one that shows something


def gray_of(rgb: np.ndarray) -> np.ndarray:
    """Gray values of an image.  uint8 [h, w, 3] -> uint8 [h, w]"""
    return np.asarray(Image.fromarray(rgb).convert("L"))


def sharpness_of(gray: np.ndarray) -> float:
    """The gradient's root mean square at fine scale over that at twice the scale.

    It is the least of four directions: a camera that moves blurs one of them.  Blur takes from
    fine scales first, so the ratio falls with it: about RAMP and less where the smallest features
    are blurred away, 0.6 and more in sharp photographs.  Contrast and exposure cancel.  Of an
    image without texture it is 0.

    Args:
        gray: [h, w] uint8
    """
    scale = SIDE / max(gray.shape)
    if scale < 1.0:
        size = [max(1, round(scale * side)) for side in gray.shape[::-1]]
        gray = np.asarray(Image.fromarray(gray).resize(size, Image.Resampling.BOX))
    if min(gray.shape) < 4:
        return 0.0
    fine = gray.astype(np.float32)
    height, width = (side // 2 * 2 for side in fine.shape)
    coarse = fine[:height, :width].reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3))
    strengths, coarse_strengths = (
        np.sqrt([(difference**2).mean() for difference in differences(i)]) for i in (fine, coarse)
    )
    if np.hypot(*coarse_strengths[:2]) <= 1.0:
        return 0.0
    return float((strengths / np.maximum(coarse_strengths, LEAST_STRENGTH)).min())


def differences(image):
    """Of neighboring pixels down, across and along both diagonals.  Four arrays"""
    return (
        np.diff(image, axis=0),
        np.diff(image, axis=1),
        image[1:, 1:] - image[:-1, :-1],
        image[1:, :-1] - image[:-1, 1:],
    )


def sharpness_weights(sharpness: ArrayLike) -> np.ndarray:
    """How much photographs count by their sharpness, LEAST_WEIGHT to 1.  [n]

    What they show makes sharpness differ.  How sharp ones differ is told by the sharpest quarter,
    as that of a normal distribution, so that many blurred ones don't hide one another.  One that
    is OUTLIER deviations below the mean, and has less than half of the fine detail's energy left,
    is blurred, and counts by that: the square of its sharpness above RAMP, over the mean's.

    Args:
        sharpness: By `sharpness_of`.  [n]
    """
    sharpness = np.asarray(sharpness, float)
    if len(sharpness) == 0:
        return sharpness
    quarter, eighth = np.percentile(sharpness, [75.0, 87.5])
    deviation = max((eighth - quarter) / (EIGHTH - QUARTER), LEAST_DEVIATION * quarter)
    mean = quarter - QUARTER * deviation
    left = np.clip((sharpness - RAMP) / max(mean - RAMP, 1e-6), 0.0, 1.0) ** 2
    is_blurred = (sharpness < mean - OUTLIER * deviation) & (left < 0.5)
    return np.where(is_blurred, np.maximum(left, LEAST_WEIGHT), 1.0)


def exposure_of(gray: np.ndarray) -> float:
    """The mean gray value, 0 to 1."""
    return float(gray.mean() / 255.0)
