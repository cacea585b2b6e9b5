"""Views show the whole object, and errors are those of the pixels that are compared."""

import numpy as np
import pytest

from deformrf.core.render import Renderer, RenderOptions, view_projection
from deformrf.wings.lab.rendering import pictures


def test_views_show_the_whole_object(ball):
    points = ball.mesh.rest_vertices
    for camera in pictures.views(ball, 3, 40):
        clip = np.c_[points, np.ones(len(points))] @ view_projection(camera, 0.1, 10.0).T
        places = np.abs(clip[:, :2] / clip[:, 3:])
        assert places.max() == pytest.approx(0.95, abs=1e-6)


def test_a_reference_is_the_image(ball):
    """In conformance mode all that is left is rounding to bytes; by default, a little more."""
    camera = pictures.view(ball, 0.3, 32)
    numbers = pictures.random_pixels(camera, 400, seed=0)
    picture = pictures.expected_pixels(ball, ball.mesh.rest_vertices, camera, numbers)
    assert picture.colors.shape == (400, 3) and picture.colors.std() > 0.1
    renderer = Renderer(ball)
    renderer.set_vertices(ball.mesh.rest_vertices)
    exact = renderer.render(camera, RenderOptions(conformance=True)).color_array()[..., :3]
    error = pictures.picture_error([exact], [picture])
    assert error.psnr > 55.0 and error.largest <= 2.0
    exact = exact.copy()
    row, column = divmod(int(picture.numbers[7]), 32)
    exact[row, column, 1] = 255 - exact[row, column, 1]
    off = abs(255 - 2 * int(exact[row, column, 1]))
    worse = pictures.picture_error([exact], [picture])
    assert abs(worse.largest - off) <= 2.0 and worse.psnr < error.psnr


def test_the_reference_differs_from_itself_by_nothing(ball):
    camera = pictures.view(ball, 0.3, 16)
    numbers = pictures.random_pixels(camera, 100, seed=0)
    picture = pictures.expected_pixels(ball, ball.mesh.rest_vertices, camera, numbers)
    same = pictures.discretization(ball, [picture], 100, finer=1)
    assert (same.psnr, same.largest) == (pictures.PEAK_DB, 0.0)
    coarse, fine = (pictures.discretization(ball, [picture], 100, finer) for finer in (2, 16))
    assert coarse.psnr >= fine.psnr > 20.0 and fine.largest > 0.0


def test_psnr_is_that_of_a_known_difference():
    a = np.full((5, 3), 0.25)
    error = pictures.image_error([a, a], [a + 0.1, a - 0.1])
    assert error.psnr == pytest.approx(20.0) and error.largest == pytest.approx(25.5)


def test_the_worst_channel_of_all_pixels_counts():
    images = np.uint8([np.full((2, 3, 3), 200), np.zeros((2, 3, 3))])
    others = images.copy()
    assert pictures.largest_difference(images, others) == 0.0
    others[0][1, 2], others[1][0, 0, 2] = (210, 197, 200), 17
    assert pictures.largest_difference(images, others) == 17.0
    assert pictures.largest_difference(others, images) == 17.0
