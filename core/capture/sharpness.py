"""How sharp and how bright a photograph is."""

import numpy as np
from PIL import Image

SIDE = 480  # longer side that images are compared at [pixels]


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


def exposure_of(gray) -> float:
    """The mean gray value, 0 to 1."""
    return float(gray.mean() / 255.0)
