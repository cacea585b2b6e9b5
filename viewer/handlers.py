"""pyglet's events to the controls and actions of an App."""

import time

from pyglet.window import key, mouse

from .controls import action_of

BUTTONS = {mouse.LEFT: "left", mouse.MIDDLE: "middle", mouse.RIGHT: "right"}


class Activity:
    """Notes that something has happened to the window, whoever deals with it.

    Pushed last, so that it sees what the panels keep to themselves, too.

    Attributes:
        last_event: When it was, by time.perf_counter.
    """

    def __init__(self, window):
        self.last_event = 0.0
        window.push_handlers(**dict.fromkeys(window.event_types, self._note))

    def _note(self, *arguments):
        self.last_event = time.perf_counter()


class Handlers:
    """The methods that a window looks for; until the App has a scene they do nothing."""

    def __init__(self, app):
        self._app = app

    def on_mouse_motion(self, x, y, dx, dy):
        if self._ready():
            self._app.controls.motion(self._pixel(x, y))

    def on_mouse_press(self, x, y, button, modifiers):
        if self._ready() and button in BUTTONS:
            shift = bool(modifiers & key.MOD_SHIFT)
            self._app.controls.press(self._pixel(x, y), BUTTONS[button], shift)

    def on_mouse_drag(self, x, y, dx, dy, buttons, modifiers):
        if self._ready():
            ratio = self._app.controls.ratio
            self._app.controls.drag(self._pixel(x, y), dx * ratio, -dy * ratio)

    def on_mouse_release(self, x, y, button, modifiers):
        if self._ready() and button in BUTTONS:
            self._app.controls.release(BUTTONS[button])

    def on_mouse_scroll(self, x, y, scroll_x, scroll_y):
        if self._ready():
            self._app.controls.scroll(self._pixel(x, y), scroll_y)

    def on_key_press(self, symbol, modifiers):
        action = action_of(key.symbol_string(symbol), bool(modifiers & key.MOD_CTRL))
        if self._ready() and action is not None:
            self._app.log("key", action=action)
            getattr(self._app.actions, action)()
        return True  # pyglet's own handler would close the window on Esc

    def on_resize(self, width, height):
        self._app.log("resize", size=[width, height], framebuffer=self._app.size)
        return True  # pyglet's own handler would set a viewport

    def _ready(self):
        return self._app.scene is not None

    def _pixel(self, x, y):
        """From pyglet's position (points, y up) to the middle of the image's pixel (y down)."""
        controls = self._app.controls
        return (x + 0.5) * controls.ratio, controls.size[1] - (y + 0.5) * controls.ratio
