"""Flight: keys move the eye, the mouse turns it, and the orbit goes on from where it ends."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import picking
from deformrf.viewer.tools.viewport import NEAREST

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    """An App without panels, ready."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    made = App(*window, EventLog(False), gui=False)
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.25
    made.frame(0.0)
    yield made
    made.close()


def press(app, *names, release=False):
    from pyglet.window import key

    event = "on_key_release" if release else "on_key_press"
    for name in names:
        app.window.dispatch_event(event, getattr(key, name), 0)
    app.window.dispatch_events()


def move_mouse(app, dx, dy):
    app.window.dispatch_event("on_mouse_motion", 50, 50, dx, dy)
    app.window.dispatch_events()


def eye(app):
    return app.scene.orbit.pose[:3, 3]


def axes(app):
    return app.scene.orbit.pose[:3, :3]


@pytest.mark.parametrize(
    "names, axis, sign",
    [("A", 0, -1), ("D", 0, 1), ("Q", 1, -1), ("E", 1, 1), ("S", 2, 1), ("DOWN", 2, 1)],
)
def test_a_held_key_moves_the_eye_as_long_as_it_is_held(app, names, axis, sign):
    press(app, "G", names)
    start, turn = eye(app), axes(app)
    for _ in range(5):
        app.frame(0.02)
    moved = turn.T @ (eye(app) - start)
    wanted = np.zeros(3)
    wanted[axis] = sign * 0.1 * app.fly.speed * app.scene.size
    assert moved == pytest.approx(wanted, abs=1e-9)
    press(app, names, release=True)
    there = eye(app)
    app.frame(0.02)
    assert eye(app) == pytest.approx(there)
    assert axes(app) == pytest.approx(turn)


def test_the_mouse_looks_around_from_where_the_eye_is(app):
    press(app, "G")
    start, before = eye(app), axes(app)
    move_mouse(app, 20, 0)
    assert eye(app) == pytest.approx(start)
    assert -axes(app)[:, 2] @ before[:, 0] > 0.05  # to the right
    before = axes(app)
    move_mouse(app, 0, 20)
    assert -axes(app)[2, 2] > -before[2, 2]  # upwards
    assert eye(app) == pytest.approx(start)


def test_flight_stops_before_the_surface(app):
    press(app, "G", "W")
    for _ in range(200):
        app.frame(0.1)
    nearest = app.radiance.depth_image().min()
    assert 0.5 * NEAREST < nearest / app.scene.size < 2.0 * NEAREST
    press(app, "S")  # both: neither forward nor back
    there = eye(app)
    app.frame(0.1)
    assert eye(app) == pytest.approx(there)


def test_afterwards_the_orbit_turns_about_the_surface_in_the_middle(app):
    app.scene.orbit = replace(app.scene.orbit, parallel=True)
    press(app, "G", "A")
    assert not app.scene.orbit.parallel
    app.frame(0.05)
    press(app, "A", release=True)
    app.frame(0.0)
    before = app.scene.orbit.pose
    press(app, "ESCAPE")
    assert not app.fly.on
    assert app.scene.orbit.pose == pytest.approx(before)
    camera = app.controls.camera
    middle = np.array([[camera.width / 2, camera.height / 2]])
    (t,) = picking.depth_at(app.radiance.depth_image(), camera, middle)
    assert np.isfinite(t) and app.scene.orbit.distance == pytest.approx(t)
    press(app, "W")  # is the wireframe again
    assert app.scene.settings.show_wireframe


def test_flight_ends_when_rays_become_parallel(app):
    for change in (lambda: press(app, "_5"), lambda: app.scene.viewpoint.go_to("flat")):
        press(app, "G")
        app.fly.begin()
        flying = app.scene.orbit
        app.scene.viewpoint.saved = {"flat": {"parallel": True}}
        change()
        assert app.scene.orbit.parallel
        for _ in range(3):
            move_mouse(app, 10, 0)
        assert not app.fly.on
        np.testing.assert_array_equal(app.scene.orbit.target, flying.target)
    app.fly.begin()
    press(app, "_5", "W")
    app.frame(0.02)
    assert not app.fly.on and app.scene.orbit.distance == flying.distance


def test_flight_has_its_keys_and_leaves_the_others(app):
    press(app, "G", "W", "H")
    assert not app.scene.settings.show_wireframe and not app.scene.settings.show_handles
    app.window.dispatch_event("on_mouse_scroll", 50, 50, 0, 2)
    app.window.dispatch_events()
    assert app.fly.speed > 0.7
    distance = app.scene.orbit.distance
    app.window.dispatch_event("on_mouse_press", 50, 50, 1, 0)
    app.window.dispatch_events()
    assert not app.fly.on and app.controls.mode == "" and app.scene.orbit.distance != distance


def test_flight_far_away_ends_at_a_border(app):
    press(app, "G", "S")
    app.fly.speed = 1e3
    for _ in range(3):
        app.frame(0.1)
    away = np.linalg.norm(eye(app) - app.scene.center)
    assert away == pytest.approx(40.0)
    near, far = orbits.clip_range(app.scene.orbit)
    assert near < away < far
