"""How soon the picture follows the hand."""

import numpy as np
import pytest

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball):
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    made = App(*window, EventLog(False), gui=False)
    made.load(ball, "ball", "cpu")
    made.canvas.use(made.size)
    yield made
    made.close()


def until_changed(app, act, most=2):
    """How many frames of 1/60 s it takes until the picture is another one."""
    for _ in range(4):
        app.frame(1 / 60)
    before = app.canvas.read().astype(int)
    act()
    app.window.dispatch_events()
    for count in range(1, most + 1):
        app.frame(1 / 60)
        if abs(app.canvas.read().astype(int) - before).max() > 8:
            return count
    return most + 1


def test_a_drag_an_orbit_and_a_zoom_show_within_two_frames(app):
    from pyglet.window import mouse

    scene, controls = app.scene, app.controls
    scene.settings.accumulate = False
    ids = scene.handles.control_ids
    handle = int(ids[np.flatnonzero(controls.shown(ids))[0]])
    controls.grab(handle)
    x, y = app.window.width // 2, app.window.height // 2

    def dispatch(name, *arguments):
        return lambda: app.window.dispatch_event(name, *arguments)

    assert until_changed(app, dispatch("on_mouse_drag", x, y, 60, 0, mouse.LEFT, 0)) <= 2
    controls.cancel()
    controls.on_mouse_press(5, 5, mouse.LEFT, 0)  # beside the object
    assert until_changed(app, dispatch("on_mouse_drag", x, y, 40, 0, mouse.LEFT, 0)) == 1
    controls.on_mouse_release(x, y, mouse.LEFT, 0)
    assert until_changed(app, dispatch("on_mouse_scroll", x, y, 0, 3)) == 1
