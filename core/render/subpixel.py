"""Smooth edges at rest: average images that are shifted by fractions of a pixel.

The shifts are Roberts' R2 sequence, whose first k points fill the pixel evenly for every k:

    s_k = frac(½ + k·(1/g, 1/g²)) - ½ in pixels, g³ = g + 1

The first image, s_0 = 0, is not shifted.
"""

from dataclasses import replace

import numpy as np
import warp as wp

from .rays.camera import Camera
from .render import Image

GENERATOR = 1.32471795724474602596  # g, the plastic number

wp.set_module_options({"enable_backward": False})


def shift(k: int) -> tuple[float, float]:
    """The shift of image k to the right and down, -½ .. ½ pixels."""
    x, y = np.mod(0.5 + k * np.array([1.0 / GENERATOR, 1.0 / GENERATOR**2]), 1.0) - 0.5
    return float(x), float(y)


def shifted(camera: Camera, k: int) -> Camera:
    """The camera of image k; of the first one, the same."""
    if k == 0:
        return camera
    (x, y), (cx, cy) = shift(k), camera.lens.center
    return replace(camera, lens=replace(camera.lens, center=(cx - x, cy - y)))


def spread(camera: Camera, count: int) -> list[Camera]:
    """`count` cameras, whose shifts are the first ones but for their mean, which is none."""
    shifts = np.array([shift(k) for k in range(count)])
    centers = np.array(camera.lens.center) - (shifts - shifts.mean(axis=0))
    lenses = [replace(camera.lens, center=tuple(center)) for center in centers.tolist()]
    return [replace(camera, lens=lens) for lens in lenses]


@wp.kernel
def add_kernel(
    color: wp.array2d(dtype=wp.vec4ub),
    first_row: int,
    sums: wp.array2d(dtype=wp.vec4i),  # in and out
):
    i, j = wp.tid()
    c = color[i, j]
    sums[first_row + i, j] = sums[first_row + i, j] + wp.vec4i(
        int(c[0]), int(c[1]), int(c[2]), int(c[3])
    )


@wp.kernel
def mean_kernel(
    sums: wp.array2d(dtype=wp.vec4i),
    count: int,
    color: wp.array2d(dtype=wp.vec4ub),  # out
):
    i, j = wp.tid()
    s = sums[i, j]
    h = count / 2  # rounds to the nearest byte
    color[i, j] = wp.vec4ub(
        wp.uint8((s[0] + h) / count), wp.uint8((s[1] + h) / count),
        wp.uint8((s[2] + h) / count), wp.uint8((s[3] + h) / count),
    )  # fmt: skip


class RunningMean:
    """The mean color of whole images that are added in strips; sums are exact integers."""

    def __init__(self, width: int, height: int, device: wp.DeviceLike):
        self._sums = wp.zeros((height, width), dtype=wp.vec4i, device=device)

    def add(self, image: Image, first_row: int = 0) -> None:
        """Add a strip (an Image) whose first row is `first_row` of the whole image."""
        height, width = image.color.shape
        assert width == self._sums.shape[1], (width, self._sums.shape)
        assert first_row + height <= self._sums.shape[0], (first_row, height, self._sums.shape)
        inputs = [image.color, first_row, self._sums]
        wp.launch(add_kernel, dim=image.color.shape, inputs=inputs, device=self._sums.device)

    def color(self, count: int) -> wp.array:
        """The mean of the `count` images added.  [H, W] vec4ub"""
        color = wp.empty(self._sums.shape, dtype=wp.vec4ub, device=self._sums.device)
        inputs = [self._sums, count]
        wp.launch(mean_kernel, dim=color.shape, inputs=inputs, outputs=[color], device=color.device)
        return color
