"""Flight: the camera moves while keys are held, and the mouse looks around.

While it lasts, its handlers are asked before all others, so that W moves and is not the
wireframe.  The orbit's target stays before the eye, as far away as the object is; afterwards
it lies on the surface that is seen in the middle.
"""

from dataclasses import replace

import numpy as np

from ..camera import CLOSEST, FARTHEST, depth_at, turned
from .keys import CTRL, key_name

WAYS = {  # keys, and where they move: right, up, backward
    ("W", "UP"): (0.0, 0.0, -1.0),
    ("S", "DOWN"): (0.0, 0.0, 1.0),
    ("A", "LEFT"): (-1.0, 0.0, 0.0),
    ("D", "RIGHT"): (1.0, 0.0, 0.0),
    ("Q",): (0.0, -1.0, 0.0),
    ("E",): (0.0, 1.0, 0.0),
}
WAY_OF = {name: np.array(way) for names, way in WAYS.items() for name in names}
SPEED, SLOWEST, FASTEST = 0.5, 0.02, 10.0  # object sizes a second
FASTER = 1.25  # for each notch of the wheel
LONGEST_STEP = 0.1  # s; a slow frame doesn't throw the camera far
FARTHEST_AWAY = 40.0  # model units from the object's center
HINT = "flying: W A S D or arrows, Q down, E up; wheel: speed; Esc or click: end"


class Fly:
    """The flight of one window's camera."""

    def __init__(self, window, controls):
        """Take a pyglet window, and the Controls of its scene."""
        self._window, self._controls, self._scene = window, controls, controls.scene
        self.on = False
        self.speed = SPEED
        self._held = set()  # keys, pyglet's names

    @property
    def line(self) -> str:
        """What the user can do, and how fast it is."""
        return f"{HINT}; {self.speed:.2g} object sizes a second"

    def toggle(self) -> None:
        """Begin, or end."""
        (self.end if self.on else self.begin)()

    def begin(self) -> None:
        """The mouse and some keys are the flight's from now on; rays are not parallel."""
        if self.on:
            return
        self._controls.cancel()
        scene = self._scene
        scene.handles.hover = None
        scene.orbit = replace(scene.orbit, parallel=False, roll=0.0)
        self.on = True
        self._held.clear()
        self._window.push_handlers(self)
        self._window.set_exclusive_mouse(True)

    def end(self) -> None:
        """The camera orbits again, about what is seen in the middle."""
        if not self.on:
            return
        self.on = False
        self._window.remove_handlers(self)
        self._window.set_exclusive_mouse(False)
        depth, camera = self._controls.depth_image(), self._controls.camera
        if depth is not None and not camera.parallel:  # whose rays start behind the eye
            middle = np.array([camera.lens.center])
            t = float(depth_at(depth, camera, middle)[0])
            self._put_target(camera.position, t if np.isfinite(t) else self._scene.orbit.distance)

    def advance(self, seconds: float) -> None:
        """Move for a time by the keys that are held."""
        self._end_if_parallel()
        ways = [WAY_OF[name] for name in self._held]
        if not self.on or not ways:
            return
        scene, camera = self._scene, self._controls.camera
        step = sum(ways) * self.speed * scene.size * min(seconds, LONGEST_STEP)
        step[2] = max(step[2], -self._controls.gap(scene.size))  # inside the object, all is white
        eye = camera.position + camera.camera_to_world[:3, :3] @ step
        away = np.linalg.norm(eye - scene.center)
        eye = scene.center + (eye - scene.center) * min(1.0, FARTHEST_AWAY / max(away, 1e-9))
        self._put_target(eye, np.linalg.norm(eye - scene.center))

    def _end_if_parallel(self):
        """A key, the panel or a view has made rays parallel: there is no eye that could fly."""
        if self.on and self._scene.orbit.parallel:
            self.end()

    def _put_target(self, eye, distance):
        orbit = self._scene.orbit
        distance = float(np.clip(distance, CLOSEST, FARTHEST))
        backward = orbit.pose[:3, 2]
        self._scene.orbit = replace(orbit, target=eye - distance * backward, distance=distance)

    # -- the window's events; True keeps them from everybody else --------------------------

    def on_key_press(self, symbol, modifiers):
        name = key_name(symbol)
        if name == "ESCAPE":
            self.end()
            return True
        if name in WAY_OF and not modifiers & CTRL:
            self._held.add(name)
            return True
        return None

    def on_key_release(self, symbol, modifiers):
        self._held.discard(key_name(symbol))

    def on_mouse_motion(self, x, y, dx, dy, *_buttons):
        self._end_if_parallel()
        if not self.on:
            return None
        eye = self._controls.camera.position
        self._scene.orbit = turned(self._scene.orbit, dx, -dy, self._window.height)
        self._put_target(eye, self._scene.orbit.distance)
        return True

    on_mouse_drag = on_mouse_motion

    def on_mouse_scroll(self, x, y, scroll_x, scroll_y):
        self.speed = float(np.clip(self.speed * FASTER**scroll_y, SLOWEST, FASTEST))
        return True

    def on_mouse_press(self, x, y, button, modifiers):
        self.end()
        return True

    def on_deactivate(self):
        self.end()
