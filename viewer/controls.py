"""The mouse: from the window's events to camera moves and drags of control vertices.

Pixels are the image's: x to the right, y down.  The methods on_* are called by the window,
with pyglet's positions (points, y up); the others know no window.
"""

from collections.abc import Callable

import numpy as np

from . import orbit as orbits
from . import picking

BUTTONS = ("left", "middle", "right")
ZOOM_PER_NOTCH = 0.88
CLICK_SLACK = 3.0  # points that the mouse may move during a click
PICK_SLACK = 5.0  # points around a sphere that still count as on it


class Controls:
    """What the mouse is doing, from one event to the next.

    Attributes:
        mode: "orbit", "pan", "grab", or "" while no button is held.
        size: Width and height of the image.
        ratio: Image pixels per point.
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
        self._miss = np.zeros(2)  # from the center of the grabbed vertex to the press
        self._pin = None  # that a click would free, and where it was pressed

    @property
    def camera(self):
        return orbits.camera(self.scene.orbit, *self.size)

    # -- the window's events -------------------------------------------------------------

    def on_mouse_motion(self, x, y, dx, dy):
        if not self.mode:
            self.scene.hover = self.pick(self._pixel(x, y))

    def on_mouse_press(self, x, y, button, modifiers):
        from pyglet.window import key, mouse  # raises without a display, so not at the top

        name = mouse.buttons_string(button).lower()
        if name in BUTTONS:
            self.press(self._pixel(x, y), name, bool(modifiers & key.MOD_SHIFT))

    def on_mouse_drag(self, x, y, dx, dy, buttons, modifiers):
        self.drag(self._pixel(x, y), dx * self.ratio, -dy * self.ratio)

    def on_mouse_release(self, x, y, button, modifiers):
        from pyglet.window import mouse

        self.release(mouse.buttons_string(button).lower())

    def on_mouse_scroll(self, x, y, scroll_x, scroll_y):
        self.scroll(self._pixel(x, y), scroll_y)

    def _pixel(self, x, y):
        """From a position in the window to the middle of the image's pixel."""
        return (x + 0.5) * self.ratio, self.size[1] - (y + 0.5) * self.ratio

    # -- the same in pixels --------------------------------------------------------------

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
            pin = self.pick(pixel, self.scene.pin_ids) if button == "left" else None
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

    # -- what is under the mouse ---------------------------------------------------------

    def pick(self, pixel, ids=None) -> int | None:
        """The vertex whose sphere is under a pixel.

        Args:
            ids: Vertices to choose from, the control vertices by default.
        """
        scene, slack = self.scene, PICK_SLACK * self.ratio
        ids = scene.control_ids if ids is None else ids
        shown = self.shown(ids)
        index = picking.pick_sphere(
            self.camera, pixel, scene.positions[ids], scene.handle_radius, shown, slack
        )
        return None if index is None else int(ids[index])

    def shown(self, ids):
        """Which of these vertices have a sphere in sight.  [len(ids)] bool"""
        scene = self.scene
        if not scene.settings.show_handles:
            return np.zeros(len(ids), bool)
        points = scene.positions[ids]
        return picking.visible(self.camera, points, self._depth_image(), scene.handle_bias)

    def _surface_at(self, pixel):
        """The object's point under a pixel; beside the object, one as far away as its target."""
        camera = self.camera
        depth = self._depth_image()
        at = np.asarray(pixel, float)
        if depth is not None:
            t = picking.depth_at(depth, camera, at[None])[0]
            if np.isfinite(t):
                return camera.position + t * picking.ray_direction(camera, at)
        return picking.onto_view_plane(camera, at, self.scene.orbit.target)

    def _grab(self, vertex, pixel):
        scene = self.scene
        (center,), _ = picking.project(self.camera, scene.positions[vertex][None])
        self._miss = np.asarray(pixel, float) - center
        scene.grab(vertex)
        scene.hover = vertex
        self.mode = "grab"
        self._log("grab", vertex=vertex, position=scene.positions[vertex], pixel=center)

    def _set_pin(self, vertex, pinned):
        self.scene.set_pin(vertex, pinned)
        self._log("pin" if pinned else "free", vertex=vertex)
