"""Mouse and keys to camera moves, drags and actions; knows no window.

Pixels are the image's: x to the right, y down.  The one table of inputs is INPUTS: key
bindings, the panel's hints and the help overlay are made from it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from . import orbit as orbits
from . import picking

ZOOM_PER_NOTCH = 0.88
CLICK_SLACK = 3.0  # logical pixels that the mouse may move during a click
PICK_SLACK = 5.0  # logical pixels around a sphere that still count as on it


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


class Controls:
    """What the mouse is doing, from one event to the next.

    Attributes:
        mode: "orbit", "pan", "grab", or "" while no button is held.
        size: Width and height of the image.
        ratio: Image pixels per logical pixel.
    """

    def __init__(self, scene, depth_image: Callable, log: Callable):
        """Take the scene, a function that returns the depth image or None, and the event log."""
        self.scene = scene
        self.mode = ""
        self.size = (1, 1)
        self.ratio = 1.0
        self._depth_image = depth_image
        self._log = log
        self._button = ""
        self._miss = np.zeros(2)  # from the grabbed vertex's centre to where it was pressed
        self._pin = None  # that a click would free, and where it was pressed

    @property
    def camera(self):
        return orbits.camera(self.scene.orbit, *self.size)

    def shown(self):
        """Which control vertices are in sight.  [C] bool"""
        return self._in_sight(self.scene.control_ids)

    def pick(self, pixel) -> int | None:
        """The control vertex under a pixel."""
        return self._pick_of(self.scene.control_ids, pixel)

    def _pick_of(self, ids, pixel):
        scene, slack = self.scene, PICK_SLACK * self.ratio
        points, shown = scene.positions[ids], self._in_sight(ids)
        index = picking.pick(self.camera, pixel, points, scene.handle_radius, shown, slack)
        return None if index is None else int(ids[index])

    def _in_sight(self, ids):
        scene = self.scene
        if not scene.settings.show_handles:
            return np.zeros(len(ids), bool)
        points = scene.positions[ids]
        return picking.visible(self.camera, points, self._depth_image(), scene.handle_bias)

    # -- mouse ---------------------------------------------------------------------------

    def motion(self, pixel) -> None:
        if not self.mode:
            self.scene.hover = self.pick(pixel)

    def press(self, pixel, button: str, shift: bool = False) -> None:
        if self.mode:  # a second button does not interrupt what the first one does
            return
        self._button = button
        vertex = self.pick(pixel) if button == "left" else None
        if vertex is not None and shift:
            self._set_pin(vertex, True)
        elif vertex is not None:
            self._grab(vertex, pixel)
        else:
            self.mode = "orbit" if button == "left" else "pan"
            pin = self._pick_of(self.scene.pin_ids, pixel) if button == "left" else None
            self._pin = None if pin is None else (pin, np.asarray(pixel, float))

    def drag(self, pixel, dx: float, dy: float) -> None:
        scene, height = self.scene, self.size[1]
        if self._pin is not None:
            if np.linalg.norm(pixel - self._pin[1]) <= CLICK_SLACK * self.ratio:
                return
            self._pin = None
        if self.mode == "grab":
            if scene.grabbed is not None:  # a reset lets go while the button is still down
                at = np.asarray(pixel, float) - self._miss
                scene.drag_to(picking.onto_view_plane(self.camera, at, scene.grabbed.target))
        elif self.mode == "orbit":
            scene.orbit = orbits.turned(scene.orbit, dx, dy, height)
        elif self.mode == "pan":
            scene.orbit = orbits.panned(scene.orbit, dx, dy, height)

    def release(self, button: str) -> None:
        if button != self._button:
            return
        if self.mode == "grab":
            if self.scene.grabbed is not None:
                vertex = self.scene.grabbed.vertex
                self.scene.release()
                self._log("release", vertex=vertex, position=self.scene.positions[vertex])
        elif self._pin is not None:
            self._set_pin(self._pin[0], False)
        elif self.mode:
            orbit = self.scene.orbit
            self._log(self.mode, yaw=orbit.yaw, pitch=orbit.pitch, target=orbit.target)
        self.mode, self._button, self._pin = "", "", None

    def scroll(self, pixel, notches: float) -> None:
        scene = self.scene
        scene.orbit = orbits.zoomed(
            scene.orbit, ZOOM_PER_NOTCH**notches, anchor=self._surface_at(pixel)
        )
        self._log("zoom", distance=scene.orbit.distance)

    def cancel(self) -> None:
        """Give up the drag: the vertex goes back to where it was taken from."""
        if self.mode != "grab":
            return
        if self.scene.grabbed is not None:
            vertex = self.scene.grabbed.vertex
            self.scene.cancel_grab()
            self._log("cancel", vertex=vertex)
        self.mode = self._button = ""

    def _set_pin(self, vertex, pinned):
        self.scene.set_pin(vertex, pinned)
        self._log("pin" if pinned else "free", vertex=vertex)

    # -- helpers -------------------------------------------------------------------------

    def _grab(self, vertex, pixel):
        scene = self.scene
        center, _ = picking.project(self.camera, scene.positions[vertex][None])
        self._miss = np.asarray(pixel, float) - center[0]
        scene.grab(vertex)
        scene.hover = vertex
        self.mode = "grab"
        self._log("grab", vertex=vertex, position=scene.positions[vertex], pixel=center[0])

    def _surface_at(self, pixel):
        """The object's point under a pixel, or else the one as far away as the orbit's target."""
        camera, scene = self.camera, self.scene
        depth = self._depth_image()
        at = np.asarray(pixel, float)
        if depth is not None:
            t = picking.depth_at(depth, camera, at[None])[0]
            if np.isfinite(t):
                return camera.position + t * picking.ray_direction(camera, at)
        return picking.onto_view_plane(camera, at, scene.orbit.target)
