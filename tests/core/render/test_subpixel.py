"""Sub-pixel samples: shifts fill the pixel evenly, their mean is the mean."""

import numpy as np
import pytest

from deformrf.core.render import (
    Renderer,
    camera_rays,
    from_field_of_view,
    look_at,
    subpixel,
)


def view(width=24, height=20):
    return from_field_of_view(look_at((1.7, -0.5, 1.0), (0.5, 0.5, 0.5)), 0.6, width, height)


def test_the_first_image_is_not_shifted():
    assert subpixel.shift(0) == (0.0, 0.0)
    camera = view()
    assert subpixel.shifted(camera, 0).lens == camera.lens


@pytest.mark.parametrize("count", [4, 8, 16])
def test_the_shifts_fill_the_pixel_evenly(count):
    shifts = np.array([subpixel.shift(k) for k in range(count)])
    assert (np.abs(shifts) <= 0.5).all()
    assert np.abs(shifts.mean(axis=0)).max() < 0.15
    apart = np.abs(shifts[:, None] - shifts)
    apart = np.linalg.norm(np.minimum(apart, 1 - apart), axis=-1)
    apart[np.arange(count), np.arange(count)] = 1
    assert apart.min() > 0.5 / np.sqrt(count)  # on a square grid it would be 1/√count


def test_a_shifted_camera_looks_through_the_shifted_point_of_the_pixel():
    camera, k = view(), int(np.random.default_rng().integers(1, 16))
    (x, y), fine = subpixel.shift(k), 1000
    moved = subpixel.shifted(camera, k)
    _, directions = camera_rays(moved)
    row, column = 13, 7
    at = round((column + 0.5 + x) * fine - 0.5), round((row + 0.5 + y) * fine - 0.5)
    larger = camera.resized(24 * fine, 20 * fine)
    local = np.array(
        [
            (at[0] + 0.5 - 0.5 * larger.width) / larger.focal,
            -(at[1] + 0.5 - 0.5 * larger.height) / larger.focal,
            -1.0,
        ]
    )
    wanted = camera.camera_to_world[:3, :3] @ (local / np.linalg.norm(local))
    np.testing.assert_allclose(directions[row * 24 + column], wanted, atol=1e-4)
    assert np.abs(directions - camera_rays(camera)[1]).max() > 1e-3


@pytest.mark.parametrize("count", [1, 4, 5])
def test_spread_cameras_look_through_the_same_pixels_in_the_mean(count):
    camera = view()
    centers = np.array([c.lens.center for c in subpixel.spread(camera, count)])
    np.testing.assert_allclose(centers.mean(axis=0), camera.lens.center, atol=1e-9)
    apart = centers - [subpixel.shifted(camera, k).lens.center for k in range(count)]
    np.testing.assert_allclose(apart, apart[:1].repeat(count, axis=0), atol=1e-9)


def test_the_mean_of_strips_is_the_mean_of_the_images(make_ball_field, device):
    renderer = Renderer(make_ball_field(int(np.random.default_rng().integers(10_000))), device)
    camera = view()
    mean, images = subpixel.RunningMean(24, 20, device), []
    for k in range(5):
        cut = int(np.random.default_rng().integers(1, 19))
        for rows in ((0, cut), (cut, 20)):
            mean.add(renderer.render(subpixel.shifted(camera, k), rows=rows), rows[0])
        images.append(renderer.render(subpixel.shifted(camera, k)).color_array().astype(int))
    wanted = np.mean(images, axis=0)
    assert np.abs(mean.color(5).numpy() - wanted).max() <= 0.5
    assert np.abs(images[0] - wanted).max() > 8
