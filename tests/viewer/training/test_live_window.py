"""A window whose scene is replaced while it is shown, as training does."""

import pytest

from deformrf.viewer.camera import picking
from deformrf.viewer.loading import Progress, prepare
from deformrf.viewer.showing import show

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    """An App with panels in a window without a display, showing a ball."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    made = App(*window, EventLog(False))
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.5
    yield made
    made.close()


def frames(app, count):
    app.run(app.frame_count + count)


def send(app, name, *arguments):
    app.window.dispatch_event(name, *arguments)
    app.window.dispatch_events()


def view_point(app, vertex):
    """A vertex in pyglet's coordinates."""
    (at,), _ = picking.project(app.controls.camera, app.scene.handles.at([vertex]))
    return round(at[0]), round(app.window.height - 1 - at[1])


def free_vertex(app):
    """A visible control vertex that no panel covers."""
    for vertex in app.scene.handles.control_ids[app.controls.shown(app.scene.handles.control_ids)]:
        if not app.gui.covers(*view_point(app, vertex)):
            return int(vertex)
    pytest.fail("the panel covers every vertex")


def test_another_scene_takes_the_place_of_the_one_before(app, ball):
    """It is drawn and dragged, and the one before hears of nothing any more."""
    from pyglet.window import mouse

    before = app.scene
    show(app, *prepare(ball, "another", "cpu", Progress("cpu")), "copy")
    app.scene.settings.show_panel = False
    frames(app, 2)
    vertex = free_vertex(app)
    x, y = view_point(app, vertex)
    send(app, "on_mouse_motion", x, y, 0, 0)
    send(app, "on_mouse_press", x, y, mouse.LEFT, 0)
    send(app, "on_mouse_drag", x + 8, y + 8, 8, 8, mouse.LEFT, 0)
    assert (before.handles.hover, before.handles.grabbed) == (None, None)
    assert app.scene.handles.grabbed.handles == [vertex]
    send(app, "on_mouse_release", x, y, mouse.LEFT, 0)
    app.scene.settings.show_panel = True
    frames(app, 2)
    send(app, "on_mouse_press", app.window.width - 60, 200, mouse.LEFT, 0)
    assert app.gui.mouse_on_panel and not app.controls.mode
