"""The object in the part of the window that the panel leaves free."""

import numpy as np
import pytest

from deformrf.viewer.camera import Covered, film_frame, in_free_part, picking
from deformrf.viewer.camera import orbit as orbits

CENTER, RADIUS = np.array([0.5, 0.4, 0.3]), 0.35


def framed(width, height, covered, ratio=1.0):
    """The camera of a view that frames a ball in the whole picture."""
    orbit = orbits.framed(orbits.Orbit(yaw=0.3, pitch=0.2), CENTER, RADIUS)
    return in_free_part(orbits.camera_of(orbit, width, height), covered, ratio)


def ball(camera):
    """The middle of the ball's picture, and its radius there [pixels]."""
    (middle,), _ = picking.project(camera, CENTER[None])
    away = np.linalg.norm(CENTER - camera.position)
    return middle, camera.focal * RADIUS / np.sqrt(away**2 - RADIUS**2)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("size", [(1200, 800), (1000, 700), (800, 900), (2400, 1600)])
def test_the_object_fits_into_what_the_panel_leaves_free(size, side):
    ratio = size[0] / 1200 if size == (2400, 1600) else 1.0
    camera = framed(*size, Covered(top=24.0, **{side: 342.0}), ratio)
    low = np.array([342.0 * ratio if side == "left" else 0.0, 24.0 * ratio])
    high = np.array([size[0] - (342.0 * ratio if side == "right" else 0.0), size[1]])
    middle, radius = ball(camera)
    assert middle == pytest.approx(0.5 * (low + high), abs=1.0)
    assert (middle - radius > low - 1.0).all() and (middle + radius < high + 1.0).all()
    assert radius > 0.49 * min(high - low)


def test_without_a_panel_the_picture_is_that_of_the_orbit():
    camera = framed(1000, 700, Covered())
    assert camera.lens == framed(1000, 700, Covered(left=900.0)).lens  # too little is left
    assert camera.lens.center == (500.0, 350.0)


def test_what_is_under_a_pixel_is_found_by_the_shifted_camera():
    camera = framed(1000, 700, Covered(342.0, 24.0))
    point = CENTER + np.array([0.1, 0.0, 0.2])
    (pixel,), _ = picking.project(camera, point[None])
    assert picking.onto_view_plane(camera, pixel, point) == pytest.approx(point, abs=1e-9)


# -- in the window -----------------------------------------------------------------------------


@pytest.fixture
def app(give_up_window, ball_field, monkeypatch, tmp_path):
    """An App with panels in a window without a display, wider than others are here."""
    from deformrf.viewer.window import WindowError, open_window

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    try:
        window = open_window((800, 500), headless=True)
    except WindowError as error:
        give_up_window(str(error))
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    made = App(*window, EventLog(False))
    made.load(ball_field, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.25
    made.scene.settings.show_handles = False
    yield made
    made.close()


@pytest.fixture
def ball_field(make_ball_field):
    return make_ball_field(1)


def middle_of_object(app):
    """The middle of what is in the picture [pixels]."""
    app.run(app.frame_count + 2)
    rows, columns = np.nonzero(app.radiance.color_image()[..., 3] > 128)
    scale = 1.0 / app.radiance.factor
    return scale * 0.5 * np.array([columns.min() + columns.max(), rows.min() + rows.max()])


@pytest.mark.gl
def test_the_picture_follows_the_panel(app):
    from deformrf.viewer.actions import ACTIONS

    tools, panel, height = 46.0, app.scene.settings.panel_width, 23 + 0.5 * (500 - 2 * 23)
    assert middle_of_object(app) == pytest.approx([tools + (754 - panel) / 2, height], abs=20)
    ACTIONS["panel_side"](app)
    assert middle_of_object(app) == pytest.approx([400 + (tools + panel) / 2, height], abs=20)
    ACTIONS["panel_narrower"](app)
    assert middle_of_object(app) == pytest.approx([380 + (tools + panel) / 2, height], abs=20)
    ACTIONS["toggle_panel"](app)
    assert middle_of_object(app) == pytest.approx([400, 260], abs=20)


@pytest.mark.gl
def test_a_pan_moves_the_object_with_the_mouse(app):
    from pyglet.window import mouse

    app.run(2)
    center = app.scene.center
    (before,), _ = picking.project(app.controls.camera, center[None])
    for name, *arguments in (
        ("on_mouse_press", 300, 200, mouse.MIDDLE, 0),
        ("on_mouse_drag", 340, 230, 40, 30, mouse.MIDDLE, 0),
        ("on_mouse_release", 340, 230, mouse.MIDDLE, 0),
    ):
        app.window.dispatch_event(name, *arguments)
        app.window.dispatch_events()
    (after,), _ = picking.project(app.controls.camera, center[None])
    assert after - before == pytest.approx([40, -30], abs=1.0)


@pytest.mark.parametrize("covered", [Covered(), Covered(left=300.0, top=20.0), Covered(bottom=500)])
@pytest.mark.parametrize("aspect", [16 / 9, 1.0, 9 / 16])
def test_the_frame_of_a_film_shows_what_the_view_shows_there(covered, aspect):
    """A point at a place of the film is at the same place of its frame in the view."""
    size, film = (1000, 700), (round(360 * aspect), 360)
    orbit = orbits.Orbit()
    left, top, width, height = film_frame(size, covered, film[0] / film[1])
    view = in_free_part(orbits.camera_of(orbit, *size), covered)
    points = np.random.default_rng(0).uniform(0.2, 0.8, (20, 3))
    seen = picking.project(view, points)[0]
    filmed = picking.project(orbits.camera_of(orbit, *film), points)[0]
    np.testing.assert_allclose(seen, [left, top] + filmed / film * [width, height], atol=0.01)
