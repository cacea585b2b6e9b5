"""Lines over the view: the box that was found, and the brush's ring and cross."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.viewer.actions import ACTIONS

BOX = [[0.2, 0.1, 0.0], [0.8, 0.9, 1.0]]


@pytest.fixture
def app(window, ball):
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    app = App(*window, EventLog(False))
    field = replace(ball, meta={"object_box": BOX, "object_stands": True})
    app.load(field, "ball", "cpu")
    app.questions.left_behind = None
    app.scene.settings.show_panel = app.scene.settings.accumulate = False
    app.scene.settings.has_dragged = True  # without the line that says how to begin
    yield app
    app.end()
    app.close()


def picture(app):
    """What the window shows, panels included."""
    for _ in range(2):
        app.frame(0.0, whole=True)
    return app.canvas.read().astype(int)


def test_edges_are_those_of_the_box():
    from deformrf.viewer.panels.overlays import box_edges

    edges = box_edges(np.array(BOX))
    low, high = np.array(BOX)
    assert edges.shape[0] == 12
    ends = {tuple(np.round(end, 6)) for edge in edges for end in (edge[0], edge[-1])}
    assert len(ends) == 8
    for edge in edges:
        assert ((edge >= low - 1e-12) & (edge <= high + 1e-12)).all()
        assert (np.ptp(edge, axis=0) > 1e-9).sum() == 1  # along one axis
    assert np.linalg.norm(edges[:, -1] - edges[:, 0], axis=1).sum() == pytest.approx(
        4 * (high - low).sum()
    )


@pytest.mark.gl
def test_the_found_box_is_drawn_and_toggled(app):
    without = picture(app)
    ACTIONS["toggle_box"](app)
    blue = (abs(picture(app) - without).sum(axis=2) > 60).sum()
    assert blue > 100
    ACTIONS["toggle_box"](app)
    np.testing.assert_array_equal(picture(app), without)


@pytest.mark.gl
def test_a_model_without_a_box_says_so(app, ball):
    app.scene.field = ball
    ACTIONS["toggle_box"](app)
    assert "no box" in app.recorder.message
    app.run(app.frame_count + 1)


@pytest.mark.gl
def test_the_brush_has_a_ring_of_its_size_and_a_cross(app):
    shapes = []
    app.window.set_mouse_cursor = shapes.append
    app.window.get_system_mouse_cursor = lambda shape: shape
    picture(app)
    app.window.dispatch_event("on_mouse_motion", 160, 120, 0, 0)
    app.window.dispatch_events()
    without = picture(app)
    ACTIONS["delete"](app)
    app.scene.settings.brush_radius = 50.0
    rows, columns = np.nonzero(abs(picture(app) - without).sum(axis=2) > 60)
    away = np.hypot(columns - 160.0, rows - 120.0)
    assert len(away) > 100 and away.min() > 46.0 and away.max() < 55.0
    ACTIONS["delete"](app)
    app.run(app.frame_count + 1)
    assert shapes == [app.window.CURSOR_CROSSHAIR, app.window.CURSOR_DEFAULT]


@pytest.mark.gl
def test_a_stroke_is_seen_at_once_and_its_undo_is_the_picture_before(app):
    controls, settings = app.controls, app.scene.settings
    settings.show_handles, settings.show_help, settings.accumulate = False, False, False
    app.frame(0.0, whole=True)
    before = app.radiance.color_image()
    settings.tool = "delete"
    controls.on_mouse_press(160, 120, 1, 1)
    app.frame(0.0, whole=True)
    during = app.radiance.color_image()
    assert (during != before).any()
    controls.on_mouse_release(160, 120, 1, 1)
    app.frame(0.0, whole=True)
    after = app.radiance.color_image().astype(int)
    assert abs(after - during).max() <= 2
    app.scene.undo()
    app.frame(0.0, whole=True)
    np.testing.assert_array_equal(app.radiance.color_image(), before)
    settings.show_wireframe = True  # of what is left
    ACTIONS["redo"](app)
    app.frame(0.0, whole=True)
