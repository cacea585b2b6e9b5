"""The mouse: from the window's events to camera moves and drags of control vertices.

The window calls the methods on_* with pyglet's positions (points, y up).  Pixels are the
image's: x to the right, y down.
"""

from collections.abc import Callable

import numpy as np

from . import orbit as orbits
from . import picking

# pyglet's numbers; the modules that name them can't be imported without a display.
LEFT, MIDDLE, RIGHT = 1, 2, 4
SHIFT = 1
PAINTED = {"stiffen": 1.2, "soften": 1.0 / 1.2}  # factors of stiffness at each event of the mouse
ZOOM_PER_NOTCH = 0.88
PAUSED = "paused: it follows when time goes on (Space), or by a step (.)"
CLICK_SLACK = 3.0  # points that the mouse may move during a click
NEAREST = 0.05  # object sizes between eye and surface, where zooming in stops
PICK_SLACK = 5.0  # points around a sphere that still count as on it


class Controls:
    """The mouse's gesture, from one event to the next."""

    def __init__(self, scene, depth_image: Callable, log: Callable, say: Callable = print):
        """Take the scene, a function that returns the depth image or None, and the event log.

        `say` shows a message to the user.
        """
        self.scene = scene
        self.mode = ""  # "orbit", "pan", "grab", "push" or "paint" while a button is held
        self.size = (1, 1)  # of the image
        self.ratio = 1.0  # image pixels per point
        self._depth_image = depth_image
        self._log, self._say = log, say
        self._button = 0
        self._miss = np.zeros(2)  # from the center of the grabbed vertex or ball to the press
        self._pin = None  # that a click would free, and where it was pressed
        self._factor = 1.0  # of the stiffness, of what is being painted

    @property
    def camera(self):
        return orbits.camera(self.scene.orbit, *self.size)

    def _pixel(self, x, y):
        """From a position in the window to the middle of the image's pixel.  [2]"""
        return np.array([(x + 0.5) * self.ratio, self.size[1] - (y + 0.5) * self.ratio])

    # -- the window's events -------------------------------------------------------------

    def on_mouse_motion(self, x, y, dx, dy):
        if not self.mode:
            pixel = self._pixel(x, y)
            control = self.pick(pixel)
            pin = self.pick(pixel, self.scene.handles.pin_ids) if control is None else None
            self.scene.handles.hover = pin if control is None else control

    def on_mouse_press(self, x, y, button, modifiers):
        if self.mode or button not in (LEFT, MIDDLE, RIGHT):
            return  # a second button does not interrupt what the first one does
        self._button = button
        pixel = self._pixel(x, y)
        if button == LEFT and self.scene.settings.tool == "push":
            self._push(pixel)
            return
        if button == LEFT and self.scene.settings.tool in PAINTED:
            self.mode, self._factor = "paint", PAINTED[self.scene.settings.tool]
            self._paint(pixel)
            return
        vertex = self.pick(pixel) if button == LEFT else None
        if vertex is not None and modifiers & SHIFT:
            self._set_pin(vertex, True)
        elif vertex is not None:
            self._grab(vertex, pixel)
        else:
            self.mode = "orbit" if button == LEFT else "pan"
            pin = self.pick(pixel, self.scene.handles.pin_ids) if button == LEFT else None
            self._pin = None if pin is None else (pin, pixel)

    def on_mouse_drag(self, x, y, dx, dy, buttons, modifiers):
        scene, pixel = self.scene, self._pixel(x, y)
        if self._pin is not None:
            if np.linalg.norm(pixel - self._pin[1]) <= CLICK_SLACK * self.ratio:
                return
            self._pin = None
        if self.mode == "push":
            if scene.ball is not None:
                center = scene.ball.target
                scene.push_to(picking.onto_view_plane(self.camera, pixel - self._miss, center))
        elif self.mode == "paint":
            self._paint(pixel)
        elif self.mode == "grab":
            grab = scene.handles.grabbed
            if grab is not None:  # a reset lets go while the button is still down
                place = grab.target.place
                place = picking.onto_view_plane(self.camera, pixel - self._miss, place)
                scene.handles.drag_to(place)
        elif self.mode:
            move = orbits.turned if self.mode == "orbit" else orbits.panned
            scene.orbit = move(scene.orbit, dx * self.ratio, -dy * self.ratio, self.size[1])

    def on_mouse_release(self, x, y, button, modifiers):
        if button != self._button:
            return
        scene = self.scene
        if self.mode == "push":
            scene.end_push()
            self._log("end_push")
        elif self.mode == "paint":
            self._log("paint", factors=scene.body.factors is not None)
        elif self.mode == "grab":
            if scene.handles.grabbed is not None:
                vertex = scene.handles.grabbed.handles[0]
                scene.handles.release()
                self._log("release", vertex=vertex, position=self._place(vertex))
        elif self._pin is not None:
            self._set_pin(self._pin[0], False)
        elif self.mode:
            orbit = scene.orbit
            self._log(self.mode, yaw=orbit.yaw, pitch=orbit.pitch, target=orbit.target)
        self.mode, self._button, self._pin = "", 0, None

    def on_mouse_scroll(self, x, y, scroll_x, scroll_y):
        scene, anchor = self.scene, self._surface_at(self._pixel(x, y))
        factor = max(ZOOM_PER_NOTCH**scroll_y, self._nearest_zoom(anchor))
        scene.orbit = orbits.zoomed(scene.orbit, factor, anchor)
        self._log("zoom", distance=scene.orbit.distance)

    def cancel(self) -> None:
        """Give up the drag: the vertex goes back to where it was taken from."""
        if self.mode == "push":
            self.scene.end_push()
            self.mode, self._button = "", 0
        if self.mode != "grab":
            return
        handles = self.scene.handles
        if handles.grabbed is not None:
            vertex = handles.grabbed.handles[0]
            handles.cancel()
            self._log("cancel", vertex=vertex)
        self.mode, self._button = "", 0

    def pin(self) -> None:
        """End the drag: what is held is pinned where it is."""
        handles = self.scene.handles
        if self.mode != "grab" or handles.grabbed is None:
            return
        vertex = handles.grabbed.handles[0]
        handles.pin_grab()
        self._log("pin", vertex=vertex, position=self._place(vertex))
        self.mode, self._button = "", 0

    # -- what is under the mouse ---------------------------------------------------------

    def pick(self, pixel, ids=None) -> int | None:
        """The vertex whose sphere is there, of these (default: the control vertices)."""
        scene, slack = self.scene, PICK_SLACK * self.ratio
        ids = scene.handles.control_ids if ids is None else ids
        shown = self.shown(ids)
        index = picking.pick_sphere(
            self.camera, pixel, scene.handles.at(ids), scene.handle_radius, shown, slack
        )
        return None if index is None else int(ids[index])

    def shown(self, ids):
        """Whether each of these vertices has a sphere in sight.  [len(ids)] bool"""
        scene = self.scene
        if not scene.settings.show_handles:
            return np.zeros(len(ids), bool)
        points = scene.handles.at(ids)
        return picking.visible(self.camera, points, self._depth_image(), scene.handle_bias)

    def _surface_at(self, pixel, beside=True):
        """The object's point under a pixel; beside the object, one as far away as its target.

        Without `beside` there is none beside the object: None.
        """
        camera, depth = self.camera, self._depth_image()
        if depth is not None:
            t = picking.depth_at(depth, camera, pixel[None])[0]
            if np.isfinite(t):
                return picking.point_at(camera, pixel, t)
        return picking.onto_view_plane(camera, pixel, self.scene.orbit.target) if beside else None

    def _nearest_zoom(self, anchor):
        """The factor of a zoom to a point that ends before the surface: inside, all is white."""
        depth = self._depth_image()
        if depth is None or self.camera.parallel:
            return 0.0
        room = max(float(depth.min()) - NEAREST * self.scene.size, 0.0)
        return min(max(1.0 - room / np.linalg.norm(anchor - self.camera.position), 0.0), 1.0)

    def _grab(self, vertex, pixel):
        scene = self.scene
        (center,), _ = picking.project(self.camera, self._place(vertex)[None])
        self._miss = pixel - center
        scene.handles.grab(vertex)
        scene.handles.hover = vertex
        self.mode = "grab"
        if scene.paused:
            self._say(PAUSED)
        self._log("grab", vertex=vertex, position=self._place(vertex), pixel=center)

    def _push(self, pixel):
        """Put the ball on the surface under the mouse."""
        scene, point = self.scene, self._surface_at(pixel)
        scene.push(point, -picking.ray(self.camera, pixel)[1])
        (center,), _ = picking.project(self.camera, scene.ball.target[None])
        self._miss = pixel - center
        self.mode = "push"
        self._log("push", position=scene.ball.target)

    def _paint(self, pixel):
        """Change the stiffness around the point under the mouse, if the object is there."""
        point = self._surface_at(pixel, beside=False)
        if point is not None:
            self.scene.paint(point, self._factor)

    def _place(self, handle):
        return self.scene.handles.at([handle])[0]

    def _set_pin(self, vertex, pinned):
        self.scene.handles.set_pin(vertex, pinned)
        self._log("pin" if pinned else "free", vertex=vertex)
