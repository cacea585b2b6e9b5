"""Random use of a scene: edits that a test lists, with frames of random lengths between them;
or any keys, clicks and drags in a window.
"""

from dataclasses import replace

import numpy as np

from deformrf.viewer.actions import inputs_of
from deformrf.viewer.camera import Covered, Orbit, camera_of, in_free_part, project
from deformrf.viewer.document import rotation_matrix
from deformrf.viewer.tools import ALT, CTRL, LEFT, MIDDLE, RIGHT, SHIFT

MODIFIERS = {"CTRL": CTRL, "ALT": ALT, "SHIFT": SHIFT}
# What would leave the scene, write a file, or open a dialog that has the keys.
LEFT_OUT = {
    *("quit", "open", "save_model", "save_session", "screenshot", "record", "save_film"),
    *("record_screen", "export_ply", "export_obj", "fly", "toggle_panel"),
    *("new", "save", "save_as", "search"),
}
OFTEN = ("move", "turn", "scale", "along_x", "along_z", "cancel", "next_gizmo", "own_axes", "bones")
NUMBERS = {"MINUS": "-", "PERIOD": ".", "BACKSPACE": "", **{f"_{n}": str(n) for n in range(10)}}


def use(scene, random, edits, count, most_frames):
    """Make `count` edits, each drawn from functions without arguments.

    Args:
        most_frames: Frames behind an edit, exclusive.
    """
    for _ in range(count):
        edits[random.integers(len(edits))]()
        for _ in range(random.integers(most_frames)):
            scene.clock.advance(float(random.uniform(0.0, 0.15)))


class Inputs:
    """Random keys, clicks and drags in the window of an App, which may have no display."""

    def __init__(self, app, random):
        self.app, self.random = app, random
        self.at, self.button = (1, 1), 0

    def send(self, name, *arguments):
        self.app.window.dispatch_event(name, *arguments)
        self.app.window.dispatch_events()

    def act(self) -> None:
        """One input."""
        (self.move, self.move, self.click, self.key, self.number, self.aim, self.choose)[
            self.random.integers(7)
        ]()

    def move(self):
        size = np.array(self.app.window.get_size())
        place = self.random.integers(0, size) if self.random.integers(3) else self._near(12.0)
        self._go(np.clip(place, 0, size - 1))

    def _near(self, reach):
        return np.round(self.at + self.random.normal(scale=reach, size=2)).astype(int)

    def _go(self, place):
        before, self.at = self.at, tuple(int(x) for x in place)
        way = np.subtract(self.at, before).tolist()
        if self.button:
            self.send("on_mouse_drag", *self.at, *way, self.button, 0)
        else:
            self.send("on_mouse_motion", *self.at, *way)

    def aim(self):
        """Go to a part of the gizmo, or to a red point or a joint."""
        controls, scene = self.app.controls, self.app.scene
        found = [part.grip for part in controls.gizmo_parts()]
        ids = scene.handles.control_ids
        places = [*scene.handles.at(ids[:20]), *(joint.place for joint in scene.rigging.joints)]
        found += list(project(controls.camera, np.reshape(places, (-1, 3)))[0])
        found = [pixel for pixel in found if np.isfinite(pixel).all()]
        if found:
            x, y = found[self.random.integers(len(found))] / controls.ratio
            size = np.array(self.app.window.get_size())
            self._go(np.clip([x, size[1] - 1 - y], 0, size - 1))

    def click(self):
        """Press a button, or let it go."""
        if self.button:
            self.send("on_mouse_release", *self.at, self.button, 0)
            self.button = 0
            return
        self.button = int(self.random.choice([LEFT, LEFT, LEFT, LEFT, MIDDLE, RIGHT]))
        self.send("on_mouse_press", *self.at, self.button, int(self.random.choice([0, 0, SHIFT])))
        if self.random.integers(6) == 0:
            self.send("on_mouse_scroll", *self.at, 0, int(self.random.choice([-1, 1])))

    def key(self):
        """A key of the preset, most of them equally often."""
        inputs = inputs_of(self.app.scene.settings.keys)
        inputs = [one for one in inputs if one.key and one.action not in LEFT_OUT]
        if self.random.integers(3) == 0:
            inputs = [one for one in inputs if one.action in OFTEN]
        *held, name = inputs[self.random.integers(len(inputs))].key.split("+")
        self._press(name, sum(MODIFIERS[one] for one in held))

    def number(self):
        """Some of a number, or Enter."""
        for name in self.random.choice([*NUMBERS, "ENTER"], self.random.integers(1, 5)):
            self._press(str(name), 0)
            if NUMBERS.get(str(name)):
                self.send("on_text", NUMBERS[str(name)])

    def _press(self, name, modifiers):
        from pyglet.window import key

        self.send("on_key_press", getattr(key, name), modifiers)
        self.send("on_key_release", getattr(key, name), modifiers)

    def choose(self):
        """Select some points, choose a joint, or other keys."""
        scene = self.app.scene
        kind = self.random.integers(3)
        ids, joints = scene.handles.control_ids, scene.rigging.joints
        if kind == 0 and len(ids) and not self.app.controls.mode:
            scene.handles.select(self.random.choice(ids, self.random.integers(1, 4)))
        elif kind == 1 and joints and not self.app.controls.mode:
            scene.rigging.selected = joints[self.random.integers(len(joints))].name
        elif self.random.integers(4) == 0:
            scene.settings.keys = str(self.random.choice(["deformrf", "blender"]))


# -- views -------------------------------------------------------------------------------------


def random_camera(random):
    """Any view of the middle, also with parallel rays and with its axis beside the middle.

    Returns:
        A camera, and pixels per point.
    """
    angles = random.uniform(-1.4, 1.4, 2)
    orbit = Orbit(distance=random.uniform(1.0, 4.0), yaw=2.0 * angles[0], pitch=angles[1])
    orbit = replace(orbit, parallel=bool(random.integers(2)))
    ratio = float(random.choice([1.0, 1.5, 2.0]))
    camera = camera_of(orbit, int(1200 * ratio), int(800 * ratio))
    return in_free_part(camera, Covered(*random.uniform(0.0, 200.0, 4)), ratio), ratio


def random_axes(random):
    """Axes that stand at right angles, in columns.  [3, 3]"""
    return rotation_matrix(random.normal(size=3))
