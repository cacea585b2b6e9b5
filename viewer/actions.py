"""What a user can do: the table of gestures and keys, and the methods that the keys call.

INPUTS is the only list: key bindings, tooltips, hints, the help overlay and README follow it.
"""

from dataclasses import dataclass

from ..core.render import MODES


@dataclass(frozen=True)
class Input:
    """One thing that a user can do.

    Attributes:
        label: How the help names the key or gesture.
        help: What it does.
        key: pyglet's name of the key, with CTRL+ before it if that is held; empty for
            gestures of the mouse.
        action: The method of Actions that the key calls.
    """

    label: str
    help: str
    key: str = ""
    action: str = ""


INPUTS = (
    Input("left drag on a red vertex", "bend the object"),
    Input("left drag elsewhere", "orbit"),
    Input("click on a gray pin", "free it"),
    Input("Shift+click on a red vertex", "pin it where it is"),
    Input("middle or right drag", "pan"),
    Input("wheel", "zoom to the mouse"),
    Input("F", "focus: the object, or the vertex under the mouse", "F", "focus"),
    Input("Home", "reset the camera", "HOME", "home"),
    Input("R", "reset the deformation", "R", "reset"),
    Input("Space", "pause, or go on", "SPACE", "pause"),
    Input(".", "single step", "PERIOD", "single_step"),
    Input("M", "next view mode: depth, normals, ...", "M", "next_mode"),
    Input("H", "hide or show the vertices", "H", "toggle_handles"),
    Input("W", "wireframe", "W", "toggle_wireframe"),
    Input("Tab", "hide or show the panel", "TAB", "toggle_panel"),
    Input("F1", "hide or show the help", "F1", "toggle_help"),
    Input("F2", "screenshot", "F2", "screenshot"),
    Input("F9", "start or stop recording", "F9", "record"),
    Input("Esc", "let go of the vertex, back to where it was", "ESCAPE", "cancel"),
    Input("Ctrl+Q", "quit", "CTRL+Q", "quit"),
)
_ACTIONS = {entry.key: entry.action for entry in INPUTS if entry.key}


def action_of(key: str, ctrl: bool) -> str | None:
    """The action of a key, by pyglet's name of it."""
    return _ACTIONS.get(f"CTRL+{key}" if ctrl else key)


def label_of(action: str) -> str:
    """The key that calls an action, as shown to the user."""
    return next(entry.label for entry in INPUTS if entry.action == action)


class Actions:
    """The commands to one App, a method for each action in INPUTS; buttons call them too."""

    def __init__(self, app):
        self._app = app

    def focus(self):
        self._app.scene.focus()

    def home(self):
        self._app.scene.home()

    def reset(self):
        self._app.controls.cancel()
        self._app.scene.reset()

    def pause(self):
        self._toggle(self._app.scene, "paused")

    def single_step(self):
        self._app.scene.single_step()

    def next_mode(self):
        settings = self._app.scene.settings
        settings.mode = MODES[(MODES.index(settings.mode) + 1) % len(MODES)]

    def toggle_handles(self):
        self._toggle(self._app.scene.settings, "show_handles")
        self._app.scene.hover = None

    def toggle_wireframe(self):
        self._toggle(self._app.scene.settings, "show_wireframe")

    def toggle_panel(self):
        self._toggle(self._app.scene.settings, "show_panel")

    def toggle_help(self):
        self._toggle(self._app.scene.settings, "show_help")

    def screenshot(self):
        self._app.recorder.screenshot()

    def record(self):
        """Start a clip, or finish the one that is being recorded."""
        recorder = self._app.recorder
        recorder.start() if recorder.video is None else recorder.stop()

    def cancel(self):
        self._app.controls.cancel()

    def quit(self):
        self._app.window.has_exit = True

    def _toggle(self, owner, name):
        setattr(owner, name, not getattr(owner, name))
