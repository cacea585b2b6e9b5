"""Lenses: distortion, its inverse, and coefficients that are refused."""

import numpy as np
import pytest
import warp as wp

from deformrf.core.render import (
    Camera,
    DeviceCamera,
    Lens,
    camera_ray,
    camera_rays,
    device_camera,
    distort,
    has_rays,
    look_at,
    pinhole,
)
from deformrf.core.render.rays.lens import undistort


def random_lens(rng):
    """A phone's: a few percent of distortion."""
    return Lens(
        90,
        160,
        tuple(rng.uniform(100, 140, 2)),
        (45 + rng.normal() * 3, 80 + rng.normal() * 3),
        tuple(rng.normal(size=4) * [0.08, 0.05, 0.01, 0.002]),
        tuple(rng.normal(size=2) * 2e-3),
    )


def test_undistorting_undoes_distorting():
    rng = np.random.default_rng()
    lens = random_lens(rng)
    x, y = rng.uniform(-0.5, 0.5, (2, 1000))
    np.testing.assert_allclose(undistort(lens, *distort(lens, x, y)[:2]), (x, y), atol=1e-9)


def test_the_jacobian_is_that_of_the_distortion():
    rng = np.random.default_rng()
    lens, e = random_lens(rng), 1e-6
    x, y = rng.uniform(-0.5, 0.5, (2, 100))
    _, _, xx, xy, yy = distort(lens, x, y)
    right, left = distort(lens, x + e, y), distort(lens, x - e, y)
    above, below = distort(lens, x, y + e), distort(lens, x, y - e)
    np.testing.assert_allclose((right[0] - left[0]) / (2 * e), xx, atol=1e-8)
    np.testing.assert_allclose((right[1] - left[1]) / (2 * e), xy, atol=1e-8)
    np.testing.assert_allclose((above[0] - below[0]) / (2 * e), xy, atol=1e-8)
    np.testing.assert_allclose((above[1] - below[1]) / (2 * e), yy, atol=1e-8)


def test_a_point_by_hand():
    """x = 0.3, y = 0.4, so r² = 0.25; one coefficient at a time."""
    x, y = 0.3, 0.4
    for radial, tangential, expected in (
        ((0.8, 0, 0, 0), (0, 0), (0.3 * 1.2, 0.4 * 1.2)),
        ((0, 0.8, 0, 0), (0, 0), (0.3 * 1.05, 0.4 * 1.05)),
        ((0, 0, 0.64, 0), (0, 0), (0.3 * 1.01, 0.4 * 1.01)),
        ((0, 0, 0, 2.56), (0, 0), (0.3 * 1.01, 0.4 * 1.01)),
        ((0, 0, 0, 0), (0.1, 0), (0.3 + 0.024, 0.4 + 0.1 * (0.25 + 0.32))),
        ((0, 0, 0, 0), (0, 0.1), (0.3 + 0.1 * (0.25 + 0.18), 0.4 + 0.024)),
    ):
        lens = Lens(10, 10, (10, 10), (5, 5), radial, tangential)
        np.testing.assert_allclose(distort(lens, x, y)[:2], expected, rtol=1e-12)


def test_a_lens_without_distortion_is_a_pinhole():
    _, directions = camera_rays(Camera(np.eye(4), pinhole(5.0, 2, 2)))
    expected = np.array([[-0.1, 0.1, -1], [0.1, 0.1, -1], [-0.1, -0.1, -1], [0.1, -0.1, -1]])
    expected /= np.sqrt(1.02)
    np.testing.assert_allclose(directions, expected)


def test_shrinking_keeps_the_view():
    lens = random_lens(np.random.default_rng())
    half = lens.resized(45, 80)
    assert (half.radial, half.tangential) == (lens.radial, lens.tangential)
    _, fine = camera_rays(Camera(np.eye(4), lens))
    _, coarse = camera_rays(Camera(np.eye(4), half))
    mean = fine.reshape(80, 2, 45, 2, 3).mean(axis=(1, 3)).reshape(-1, 3)
    np.testing.assert_allclose(coarse, mean, atol=1e-4)  # a pixel is 1e-2


@wp.kernel
def rays_kernel(
    camera: DeviceCamera, origins: wp.array(dtype=wp.vec3), directions: wp.array(dtype=wp.vec3)
):
    i = wp.tid()
    origin, direction = camera_ray(camera, i % camera.lens.width, i / camera.lens.width)
    origins[i] = origin
    directions[i] = direction


@pytest.mark.parametrize("parallel", [False, True])
def test_rays_of_the_kernel_are_those_of_the_reference(device, parallel):
    lens = random_lens(np.random.default_rng())
    camera = Camera(look_at((1, 2, 3), (0, 0, 0)), lens, parallel)
    rays = [wp.empty(camera.width * camera.height, dtype=wp.vec3, device=device) for _ in range(2)]
    wp.launch(rays_kernel, len(rays[0]), [device_camera(camera)], rays, device=device)
    for found, expected in zip(rays, camera_rays(camera), strict=True):
        np.testing.assert_allclose(found.numpy(), expected, atol=1e-6)


@pytest.mark.parametrize(
    "radial, tangential, ok",
    [
        ((0.0578421, -0.0805099, 0, 0), (-0.000980296, 0.00015575), True),  # a phone's
        ((-0.3, 0.1, 0, 0), (0, 0), True),
        ((-1.5, 0, 0, 0), (0, 0), False),  # turns back before the image's corner
        ((0, 0, 0, 0), (2.0, 0), False),
    ],
)
def test_extreme_coefficients_have_no_rays(radial, tangential, ok):
    assert has_rays(Lens(90, 160, (115, 115), (45, 80), radial, tangential)) == ok
