"""Lenses: intrinsics and distortion, from directions to pixels and back.

OpenCV's model and axes (x right, y down, z forward).  With the normalized coordinates of a
direction, (x, y) = (X/Z, Y/Z), and r² = x² + y²:

    x_d = x·(1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + 2 p1 x y + p2 (r² + 2 x²)
    y_d = y·(1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + p1 (r² + 2 y²) + 2 p2 x y
    u = fx x_d + cx,   v = fy y_d + cy

Pixel (column i, row j) has its center at u = i + ½, v = j + ½.  The inverse, from a pixel to
its direction, has no closed form; Newton's method doubles the correct digits with each step.
"""

from dataclasses import dataclass, replace

import numpy as np
import warp as wp

NEWTON_STEPS = 10  # ordinary lenses take three
UNDISTORT_TOLERANCE = 1e-6  # of normalized coordinates; a pixel is about 1e-3

wp.set_module_options({"enable_backward": False})


@dataclass(frozen=True)
class Lens:
    """Intrinsics in pixels, and distortion."""

    width: int  # of the image
    height: int
    focal: tuple[float, float]  # fx, fy
    center: tuple[float, float]  # cx, cy: the principal point
    radial: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # k1, k2, k3, k4
    tangential: tuple[float, float] = (0.0, 0.0)  # p1, p2

    @property
    def is_distorted(self) -> bool:
        return any(self.radial) or any(self.tangential)

    def resized(self, width: int, height: int) -> "Lens":
        """The lens of the resized photograph: each axis is scaled by itself."""
        x, y = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            focal=(self.focal[0] * x, self.focal[1] * y),
            center=(self.center[0] * x, self.center[1] * y),
        )


def pinhole(focal: float, width: int, height: int) -> Lens:
    """A lens without distortion whose axis passes through the center of the image."""
    return Lens(width, height, (focal, focal), (0.5 * width, 0.5 * height))


def distort(lens: Lens, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Normalized to distorted coordinates.

    Returns:
        x_d, y_d and the Jacobian's distinct entries ∂x_d/∂x, ∂x_d/∂y = ∂y_d/∂x, ∂y_d/∂y.
    """
    (k1, k2, k3, k4), (p1, p2) = lens.radial, lens.tangential
    r2 = x * x + y * y
    factor = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    slope = k1 + r2 * (2 * k2 + r2 * (3 * k3 + r2 * 4 * k4))  # ∂factor/∂r²
    return (
        x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * factor + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        factor + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x,
        2 * x * y * slope + 2 * p1 * x + 2 * p2 * y,
        factor + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x,
    )


def undistort(lens: Lens, x_d, y_d):
    """Distorted to normalized coordinates."""
    x, y = np.array(x_d, float), np.array(y_d, float)
    for _ in range(NEWTON_STEPS if lens.is_distorted else 0):
        u, v, xx, xy, yy = distort(lens, x, y)
        determinant = xx * yy - xy * xy
        x = x - (yy * (u - x_d) - xy * (v - y_d)) / determinant
        y = y - (xx * (v - y_d) - xy * (u - x_d)) / determinant
    return x, y


def has_rays(lens: Lens) -> bool:
    """Whether every pixel on the border of the image has one ray; extreme coefficients leave none.

    The distortion must also grow monotonically up to the border: beyond a turning point the
    lens would show one direction at two pixels.
    """
    along, low, high = np.linspace(0, 1, 33), np.zeros(33), np.ones(33)
    u, v = np.concatenate([along, along, low, high]), np.concatenate([low, high, along, along])
    x_d = (u * lens.width - lens.center[0]) / lens.focal[0]
    y_d = (v * lens.height - lens.center[1]) / lens.focal[1]
    with np.errstate(all="ignore"):
        x, y = undistort(lens, x_d, y_d)
        grown = [distort(lens, s * x, s * y) for s in np.linspace(0, 1, 33)]
        again = grown[-1]
        error = np.hypot(again[0] - x_d, again[1] - y_d)
        determinants = np.array([xx * yy - xy * xy for _, _, xx, xy, yy in grown])
    return bool((error < UNDISTORT_TOLERANCE).all() and (determinants > 0).all())


@wp.struct
class DeviceLens:
    """`Lens` for kernels."""

    width: int
    height: int
    focal: wp.vec2
    center: wp.vec2
    radial: wp.vec4
    tangential: wp.vec2
    newton_steps: int  # 0 without distortion


def device_lens(lens: Lens) -> DeviceLens:
    value = DeviceLens()
    value.width, value.height = lens.width, lens.height
    value.focal, value.center = wp.vec2(*lens.focal), wp.vec2(*lens.center)
    value.radial, value.tangential = wp.vec4(*lens.radial), wp.vec2(*lens.tangential)
    value.newton_steps = NEWTON_STEPS if lens.is_distorted else 0
    return value


@wp.func
def undistorted(lens: DeviceLens, distorted: wp.vec2):
    """`undistort` on the device."""
    x = float(distorted[0])
    y = float(distorted[1])
    p1 = lens.tangential[0]
    p2 = lens.tangential[1]
    k = lens.radial
    steps_left = int(lens.newton_steps)
    while steps_left > 0:
        r2 = x * x + y * y
        factor = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])))
        slope = k[0] + r2 * (2.0 * k[1] + r2 * (3.0 * k[2] + r2 * 4.0 * k[3]))
        u = x * factor + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - distorted[0]
        v = y * factor + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - distorted[1]
        xx = factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        xy = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        yy = factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        determinant = xx * yy - xy * xy
        x -= (yy * u - xy * v) / determinant
        y -= (xx * v - xy * u) / determinant
        steps_left -= 1
        if wp.abs(u) + wp.abs(v) < 1.0e-7:
            steps_left = 0
    return wp.vec2(x, y)


@wp.func
def lens_direction(lens: DeviceLens, column: int, row: int):
    """The unit direction of a pixel's center, in camera space with OpenGL's axes."""
    distorted = wp.vec2(
        (float(column) + 0.5 - lens.center[0]) / lens.focal[0],
        (float(row) + 0.5 - lens.center[1]) / lens.focal[1],
    )
    p = undistorted(lens, distorted)
    return wp.normalize(wp.vec3(p[0], -p[1], -1.0))
