"""An App with panels in a window without a display: its keys and its mouse."""

from contextlib import contextmanager

from deformrf.viewer.actions import ACTIONS


@contextmanager
def opened(window, ball, monkeypatch, tmp_path):
    """The App, of a ball, in an empty folder."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("HOME", str(tmp_path / "here"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    made = App(*window, EventLog(False))
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.25
    frames(made)
    try:
        yield made
    finally:
        made.close()


def frames(app, count=2):
    app.run(app.frame_count + count)


def send(app, name, *arguments):
    app.window.dispatch_event(name, *arguments)
    app.window.dispatch_events()


def press(app, symbol, modifiers=0):
    """Press a key and let it go, with frames between."""
    for name in ("on_key_press", "on_key_release"):
        send(app, name, symbol, modifiers)
        frames(app)


def quit_by(app, how):
    from pyglet.window import key

    if how == "key":
        send(app, "on_key_press", key.Q, key.MOD_CTRL)
    elif how == "menu":
        ACTIONS["quit"](app)
    else:
        send(app, "on_close")


def places_of_buttons(monkeypatch):
    """Where they were drawn last, in ImGui's coordinates, by label: it changes with each frame."""
    from imgui_bundle import imgui

    found, draw = {}, imgui.button

    def noted(label, *arguments):
        result = draw(label, *arguments)
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        found[label] = round(0.5 * (low.x + high.x)), round(0.5 * (low.y + high.y))
        return result

    monkeypatch.setattr(imgui, "button", noted)
    return found


def click(app, place):
    from pyglet.window import mouse

    at = place[0], app.window.height - 1 - place[1]
    send(app, "on_mouse_motion", *at, 0, 0)
    for name in ("on_mouse_press", "on_mouse_release"):
        frames(app)
        if app.window.has_exit:
            return
        send(app, name, *at, mouse.LEFT, 0)
    frames(app)
