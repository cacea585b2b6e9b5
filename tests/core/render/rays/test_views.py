"""Views as rows of numbers: they come back as cameras, and nonsense doesn't."""

import numpy as np

from deformrf.core.render import Camera, Lens, camera_rays, look_at, rows_of_views, views_of_rows
from deformrf.core.render.rays.views import MOST


def test_a_view_comes_back_with_the_same_rays():
    pose = look_at((1.5, -0.7, 0.9), (0.5, 0.5, 0.4))
    lens = Lens(400, 300, (350.0, 350.0), (190.0, 160.0))
    (camera,) = views_of_rows(rows_of_views(pose[None], [lens]), 400)
    assert (camera.width, camera.height) == (400, 300)
    for found, wanted in zip(camera_rays(camera), camera_rays(Camera(pose, lens)), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-4)


def test_another_width_shows_the_same():
    pose, lens = (
        look_at((2.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        Lens(400, 300, (350.0, 340.0), (200, 150)),
    )
    (small,) = views_of_rows(rows_of_views(pose[None], [lens]), 100)
    np.testing.assert_allclose(small.lens.center[0] / small.lens.focal[0], 200 / 350, atol=1e-4)
    assert abs(small.height - 100 * (300 / 340) / (400 / 350)) < 1.0


def test_many_are_thinned_out():
    count = 2 * MOST
    rows = rows_of_views(
        np.tile(np.eye(4), (count, 1, 1)), [Lens(4, 3, (4.0, 4.0), (2, 1.5))] * count
    )
    assert MOST / 2 <= len(rows) <= MOST


def test_what_is_no_camera_is_left_out():
    good = [*np.eye(4)[:3].ravel(), -1.0, 1.0, -1.0, 1.0]
    assert len(views_of_rows([good], 64)) == 1 and views_of_rows([], 64) == []
    for place, value in ((0, 3.0), (3, 1e30), (12, 1.0), (13, 1e5), (14, -90.0), (15, -2.0)):
        assert views_of_rows([[*good[:place], value, *good[place + 1 :]]], 64) == []
