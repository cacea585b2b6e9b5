"""The tool in the hand at the start: it bends the object, and selects red points.

A drag takes a red point, or the object's surface; a click selects, frees a pin, or lets a posed
point go.
"""

import time

import numpy as np

from ..camera import project
from ..document import MOST_ADDED
from . import drags
from .drags import MOVE, Constraint
from .gizmo import Gizmo, best_rotation
from .keys import ALT, CTRL, SHIFT
from .tool import DragTool
from .viewport import CLICK_SLACK

ORBITS = {"alt": ALT, "ctrl": CTRL, "shift": SHIFT}  # of Settings.orbit_key
PAUSED = "paused: it follows when time goes on (Space), by a step (.), or if it stays (N)"
STAYS = "it stays there; a click on the violet point lets it go"
DOUBLE_CLICK = 0.4  # s between two presses at one place
WIDER_PER_NOTCH = 1.15  # the grab radius, during a drag


class Bend(DragTool):
    """Drags handles.

    Attributes:
        spot: Of the surface, where a drag from under the mouse would take hold; or None.  [3]
    """

    cross = False
    hint = (
        "Drag the object or a red point to bend it.  Beside it: orbit.  Click: select.  Wheel: zoom"
    )
    spot = None
    _picked = _pin = None  # a handle that a drag would grab, a pin that a click frees
    _before = -np.inf, np.zeros(2)  # when and where a button went down before

    def hover(self, pixel) -> None:
        control = self.view.pick(pixel)
        pin = self.view.pick(pixel, self.handles.pin_ids) if control is None else None
        self.handles.hover = found = pin if control is None else control
        self.spot = self._place_under(pixel) if found is None else None

    def leave(self) -> None:
        self.handles.hover = self.spot = None

    def _place_under(self, pixel):
        """The place of the object's surface that a drag from a pixel takes; None if it orbits."""
        if not self.scene.settings.grab_anywhere:
            return None
        return self.view.surface_at(pixel, beside=False)

    # -- the mouse -----------------------------------------------------------------------

    def press(self, pixel, modifiers) -> bool:
        settings = self.scene.settings
        handle, self.spot = self.view.pick(pixel), None
        if handle is None:
            self._pin = self.view.pick(pixel, self.handles.pin_ids)
            if self._pin is None and self._is_second(pixel):
                return self._add_point(pixel)
            if self._pin is None and not modifiers & ORBITS[settings.orbit_key]:
                self.spot = self._place_under(pixel)
            self.mode = "orbit"  # so far: a click frees the pin, or selects nothing
            return self._pin is not None or self.spot is not None
        self.mode, self._picked = "pick", handle
        if modifiers & (SHIFT | CTRL):
            self.handles.select([handle], "toggle" if modifiers & SHIFT else "remove")
            self._picked = handle if handle in self.handles.selected else None
        return True

    def _is_second(self, pixel):
        """Whether a press is the second one of a double click."""
        (since, place), now = self._before, time.monotonic()
        self._before = now, pixel
        near = np.linalg.norm(pixel - place) <= CLICK_SLACK * self.view.ratio
        return near and now - since < DOUBLE_CLICK

    def _add_point(self, pixel):
        """Make a control point on the surface under the mouse; a drag from here takes it."""
        point = self.view.surface_at(pixel, beside=False)
        if not self._has_room() or point is None:
            return False
        self._picked, self.mode = self.handles.add_point(point), "pick"
        self.view.log("add_point", vertex=self._picked, position=point)
        return True

    def _has_room(self):
        """Whether there can be another control point."""
        if len(self.handles.points) >= MOST_ADDED:
            self.view.say(f"{MOST_ADDED} red points are the most")
            return False
        return True

    @property
    def waits(self) -> bool:
        return self.mode != "grab"

    def move(self, before, pixel) -> bool:
        if self.mode == "pick" and self._picked is not None:
            self.grab(self._picked)
        elif self.mode == "orbit":
            if self.spot is None:
                return False  # from a pin, the drag is the camera's
            self._grab_place()
        if self.mode == "grab":
            self.follow(pixel)
        return True

    def release(self, pixel, clicked, modifiers) -> None:
        if self.mode == "grab":
            self.finish()
        elif self._pin is not None:
            self._set_pin(self._pin, False)
        elif self.mode == "orbit":
            self.click(pixel)
        else:
            self._end_click(modifiers)

    def click(self, pixel) -> None:
        if self.handles.selected:
            self.handles.select([])
            self.view.log("select", vertices=[])

    def _end_click(self, modifiers):
        """A click on a handle: a posed one is let go, any other one selected."""
        # Where the press took it out of the selection, it is none, also if Shift is up again.
        alone = self._picked is not None and not modifiers & (SHIFT | CTRL)
        if alone and self._picked in self.handles.posed:
            self._set_pin(self._picked, False)
            return
        if alone:
            self.handles.select([self._picked])
        self.view.log("select", vertices=self.handles.selected)

    def wheel(self, notches) -> bool:
        if self.mode != "grab" or self.handles.grabbed is None:
            return False
        self.handles.widen(WIDER_PER_NOTCH**notches)
        self.view.say(f"grab radius {self.scene.settings.grab_radius:.2f} of the size")
        return True

    def cancel(self) -> None:
        if self.mode == "grab" and self.handles.grabbed is not None:
            vertex = self._vertex
            self.handles.cancel()
            self.view.log("cancel", vertex=vertex)

    def end(self) -> None:
        self.mode, self.drag, self.spot = "", None, None
        self._picked = self._pin = None

    # -- a drag --------------------------------------------------------------------------

    def _grab_place(self):
        """Begin the drag of the place on which the button went down."""
        place, self.spot = self.spot, None
        if self._has_room():
            self.handles.grab_place(place)
            self._begin_drag()

    def grab(self, handle) -> None:
        """Begin the drag of a handle on which the button went down."""
        if handle not in self.handles.selected:
            self.handles.select([])
        self.handles.grab(handle)
        self.handles.hover = handle
        self._begin_drag()

    @property
    def _vertex(self):
        """The first handle of what is grabbed."""
        return self.handles.grabbed.handles[0]

    def _begin_drag(self):
        scene, view, handle = self.scene, self.view, self._vertex
        (center,), _ = project(view.camera, self._place(handle)[None])
        held = Constraint(own=self._axes())
        self.drag = drags.Drag(view.press_at, view.press_at - center, held=held)
        view.pointer = view.press_at
        self.mode = "grab"
        if scene.clock.paused and scene.settings.hand != "pose":
            self.view.say(PAUSED)
        self.view.log("grab", vertex=handle, position=self._place(handle), pixel=center)

    def finish(self) -> None:
        if self.handles.grabbed is not None:
            vertex = self._vertex
            position = self._place(vertex)
            self.handles.let_go()
            if vertex in self.handles.posed:
                self.view.say(STAYS)
            self.scene.settings.has_dragged = True
            self.view.log("release", vertex=vertex, position=position)

    def pin(self) -> bool:
        """Pin what is held, where it is; else what is selected or under the mouse."""
        if self.mode == "grab":
            if self.handles.grabbed is not None:
                vertex = self._vertex
                self.handles.pin_grab()
                self.view.log("pin", vertex=vertex, position=self._place(vertex))
            return True
        chosen = self.handles.selected or [one for one in [self.handles.hover] if one is not None]
        if not chosen:
            self.view.say("nothing to pin: select red points, or point at one")
            return False
        handles = self.handles
        free = [one for one in chosen if one in handles.posed or not handles.is_pinned(one)]
        self.handles.set_pins(free or chosen, bool(free))
        self.view.log("pin" if free else "free", vertex=chosen[0])
        return False

    def _place(self, handle):
        return self.handles.at([handle])[0]

    def _set_pin(self, vertex, pinned):
        self.handles.set_pin(vertex, pinned)
        self.view.log("pin" if pinned else "free", vertex=vertex)

    # -- by keys and by the gizmo --------------------------------------------------------

    @property
    def gizmo(self):
        settings = self.scene.settings
        ids = self.handles.takeable if settings.show_handles and settings.gizmo != "off" else []
        if not ids:
            return None
        axes = self._axes() if settings.own_axes else np.eye(3)
        return Gizmo(settings.gizmo, self.handles.at(ids).mean(axis=0), axes)

    def has_before_gizmo(self, pixel) -> bool:
        return self.view.pick(pixel) is not None

    def _axes(self):
        """What has become of model space's axes where the selection is, in columns.  [3, 3]"""
        scene, grabbed = self.scene, self.handles.grabbed
        held = self.handles.takeable if grabbed is None else grabbed.handles
        if not held:
            return np.eye(3)
        ids = np.unique(np.concatenate([self.handles.corners(one) for one in held]))
        if len(ids) < 4:  # single vertices: freed pins
            ids = self.handles.patch(held[0], scene.grab_radius)
        return best_rotation(scene.field.mesh.rest_vertices[ids], scene.positions[ids])

    @property
    def held_drag(self):
        held = self.mode == "grab" and self.handles.grabbed is not None
        return self.drag if held else None

    @property
    def drag_place(self):
        motion, drag = self.handles.grabbed.target, self.drag
        return motion.place + (drag.anchor if drag.kind == MOVE else motion.center)

    def follow(self, pixel) -> None:
        if self.held_drag is not None:  # a reset lets go while a button is down
            drags.follow(self.drag, self.handles, self.view.camera, pixel, self.view.ratio)

    def take(self, kind) -> bool:
        chosen = self.handles.takeable if self.scene.settings.show_handles else []
        if chosen and not drags.is_ahead(self.view.camera, self.handles.at(chosen).mean(axis=0)):
            self.view.say(drags.BEHIND)
        elif chosen:
            self.handles.grab_selected()
            self._begin_drag()
        elif self.handles.hover in self.handles.control_ids:
            self.grab(self.handles.hover)
        elif self.spot is not None:
            self._grab_place()
        else:
            self.view.say(drags.NOTHING.format(kind))
        if self.mode != "grab":
            return False
        # From now on the mouse has it by its middle.
        self.drag.anchor = self.handles.grabbed.target.center
        self._go_on(kind, self.view.press_at)
        return True

    def turn_into(self, kind) -> None:
        self._go_on(MOVE if self.drag.kind == kind else kind, self.view.pointer)

    def _go_on(self, kind, pixel):
        motion, drag = self.handles.grabbed.target, self.drag
        drag.begin(kind, motion, self.view.camera, pixel, motion.place + drag.anchor)
