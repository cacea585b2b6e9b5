"""Errors of an image against the truth: PSNR and SSIM, for values in [0, 1].

PSNR  = −10 log₁₀ mean (a − b)²                                                      [dB]

SSIM  = (2 μa μb + C₁)(2 σab + C₂) / ((μa² + μb² + C₁)(σa² + σb² + C₂))
        with means, variances and covariance under an 11×11 Gaussian window of σ = 1.5,
        C₁ = (0.01)², C₂ = (0.03)², per channel; Wang et al. 2004.

SSIM's windows lie wholly inside the image: the valid region, without 5 pixels on each side.
The result is the mean over windows and channels.  This is the convention of the
original paper; libraries differ in window, border and data range.

Shapes: a, b [H, W, C] or [H, W], any real dtype.
"""

import numpy as np

WINDOW_SIZE = 11  # pixels
WINDOW_SIGMA = 1.5  # pixels
C1, C2 = 0.01**2, 0.03**2


def psnr(a, b) -> float:
    """Peak signal-to-noise ratio in dB; infinite for equal images."""
    a, b = as_float64(a, b)
    error = np.mean((a - b) ** 2)
    return float(-10.0 * np.log10(error)) if error > 0.0 else float("inf")


def ssim(a, b) -> float:
    """Structural similarity, 1 for equal images."""
    a, b = as_float64(a, b)
    check_size(*a.shape[:2])
    mean_a, mean_b = blur(a), blur(b)
    variance_a = blur(a * a) - mean_a**2
    variance_b = blur(b * b) - mean_b**2
    covariance = blur(a * b) - mean_a * mean_b
    similarity = (2 * mean_a * mean_b + C1) * (2 * covariance + C2)
    similarity /= (mean_a**2 + mean_b**2 + C1) * (variance_a + variance_b + C2)
    return float(similarity.mean())


def check_size(height: int, width: int, metric: str = "SSIM", smallest: int = WINDOW_SIZE) -> None:
    """Raise ValueError if an image is too small for a metric, such as one window of SSIM."""
    if min(height, width) < smallest:
        raise ValueError(
            f"{metric} needs images of at least {smallest}x{smallest} pixels, "
            f"these have {width}x{height}"
        )


def blur(image):
    """Mean of every whole window; the Gaussian is separable.  [H − 10, W − 10, ...]"""
    weights = np.exp(-0.5 * ((np.arange(WINDOW_SIZE) - WINDOW_SIZE // 2) / WINDOW_SIGMA) ** 2)
    weights /= weights.sum()
    rows, columns = (size - WINDOW_SIZE + 1 for size in image.shape[:2])
    image = sum(w * image[i : i + rows] for i, w in enumerate(weights))
    return sum(w * image[:, i : i + columns] for i, w in enumerate(weights))


def as_float64(a, b):
    """Both images in float64; ValueError if they can't be compared."""
    a, b = np.asarray(a), np.asarray(b)
    if a.shape != b.shape:
        raise ValueError(f"images of different shapes can't be compared: {a.shape} and {b.shape}")
    for image in (a, b):  # 8-bit values would give plausible, wrong numbers
        if not np.issubdtype(image.dtype, np.floating):
            raise ValueError(f"images must hold floats in [0, 1], not {image.dtype}")
    return a.astype(np.float64), b.astype(np.float64)
