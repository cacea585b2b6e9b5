"""How sharp and how bright a photograph is."""

import numpy as np
from PIL import Image

SIDE = 480  # longer side that images are compared at [pixels]
RAMP = 0.5  # sharpness of an image without detail at the fine scale
OUTLIER = 3.0  # spreads below the median, from which a photograph is blurred
LEAST_SPREAD = 0.02  # of the median
LEAST_WEIGHT = 0.1  # of a photograph: it may be the only one that shows something


def gray_of(rgb):
    """Gray values of an image.  uint8 [h, w, 3] -> uint8 [h, w]"""
    return np.asarray(Image.fromarray(rgb).convert("L"))


def sharpness_of(gray) -> float:
    """The gradient's root mean square at fine scale over that at twice the scale.

    Blur takes from fine scales first, so the ratio falls with it: about 0.5 and less where the
    smallest features are blurred away, 0.6 and more in sharp photographs.  Contrast and exposure
    cancel.  Of an image without texture it is 0.

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
    strengths = [
        np.sqrt((np.diff(i, axis=0) ** 2).mean() + (np.diff(i, axis=1) ** 2).mean())
        for i in (fine, coarse)
    ]
    return float(strengths[0] / strengths[1]) if strengths[1] > 1.0 else 0.0


def sharpness_weights(sharpness):
    """How much photographs count by their sharpness, LEAST_WEIGHT to 1.  [n]

    What they show makes sharpness differ, by a spread that the sharper half tells.  One that is
    OUTLIER times as far below the median is blurred, and counts by the energy of the fine detail
    that it has left: the square of its sharpness above RAMP, over the median's.

    Args:
        sharpness: By `sharpness_of`.  [n]
    """
    sharpness = np.asarray(sharpness, float)
    if len(sharpness) == 0:
        return sharpness
    median = np.median(sharpness)
    # 1.48: from the median of deviations to a normal distribution's standard deviation.
    spread = 1.4826 * np.median(sharpness[sharpness >= median] - median)
    is_blurred = sharpness < median - OUTLIER * max(spread, LEAST_SPREAD * median)
    left = np.clip((sharpness - RAMP) / max(median - RAMP, 1e-6), 0.0, 1.0)
    return np.where(is_blurred, np.maximum(left**2, LEAST_WEIGHT), 1.0)


def exposure_of(gray) -> float:
    """The mean gray value, 0 to 1."""
    return float(gray.mean() / 255.0)
