"""The tool in the hand at the start: it bends the object, and selects red points.

A drag takes a red point, or the object's surface; a click selects, frees a pin, or lets a posed
point go.
"""

import time

import numpy as np

from ..camera import project
from ..document import MOST_ADDED
from . import drags
from .constraints import MOVE, Constraint
from .gizmo import Gizmo, best_rotation
from .keys import ALT, CTRL, SHIFT
from .tool import DragTool
from .viewport import CLICK_SLACK

ORBITS = {"alt": ALT, "ctrl": CTRL, "shift": SHIFT}  # of Settings.orbit_key
PAUSED = "paused: it follows when time goes on (Space), by a step (.), or in Pose (N)"
STAYS = "it stays there; a click on the golden point lets it go"
DOUBLE_CLICK = 0.4  # s between two presses at one place
WIDER_PER_NOTCH = 1.15  # the grab radius, during a drag


class Bend(DragTool):
    """Drags handles.

    Attributes:
        spot: Of the surface, where a drag from under the mouse would take hold; or None.  [3]
        dragging: The Drag of what is grabbed.
    """

    word = "Bend"
    name, title, icon, cross = "grab", "Bend", "hand_pointer", False
    hint = (
        "Drag the object or a red point to bend it.  Beside it: orbit.  Click: select.  Wheel: zoom"
    )

    spot = dragging = None
    _picked = _pin = None  # a handle that a drag would grab, a pin that a click frees
    _before = -np.inf, np.zeros(2)  # when and where a button went down before

    def hover(self, pixel) -> None:
        handles = self.scene.handles
        control = self.pick(pixel)
        pin = self.pick(pixel, handles.pin_ids) if control is None else None
        handles.hover = found = pin if control is None else control
        self.spot = self._place_under(pixel) if found is None else None

    def leave(self) -> None:
        self.scene.handles.hover = self.spot = None

    def _place_under(self, pixel):
        """The place of the object's surface that a drag from a pixel takes; None if it orbits."""
        if not self.scene.settings.grab_anywhere:
            return None
        return self.view.surface_at(pixel, beside=False)

    # -- the mouse -----------------------------------------------------------------------

    def press(self, pixel, modifiers) -> bool:
        handles, settings = self.scene.handles, self.scene.settings
        handle, self.spot = self.pick(pixel), None
        if handle is None:
            self._pin = self.pick(pixel, handles.pin_ids)
            if self._pin is None and self._is_second(pixel):
                return self._add_point(pixel)
            if self._pin is None and not modifiers & ORBITS[settings.orbit_key]:
                self.spot = self._place_under(pixel)
            self.mode = "orbit"  # so far: a click frees the pin, or selects nothing
            return self._pin is not None or self.spot is not None
        self.mode, self._picked = "pick", handle
        if modifiers & (SHIFT | CTRL):
            handles.select([handle], "toggle" if modifiers & SHIFT else "remove")
            self._picked = handle if handle in handles.selected else None
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
        self._picked, self.mode = self.scene.handles.add_point(point), "pick"
        self.told.log("add_point", vertex=self._picked, position=point)
        return True

    def _has_room(self):
        """Whether there can be another control point."""
        if len(self.scene.handles.points) >= MOST_ADDED:
            self.told.say(f"{MOST_ADDED} red points are the most")
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
        handles = self.scene.handles
        if handles.selected:
            handles.select([])
            self.told.log("select", vertices=[])

    def _end_click(self, modifiers):
        """A click on a handle: a posed one is let go, any other one selected."""
        handles = self.scene.handles
        # Where the press took it out of the selection, it is none, also if Shift is up again.
        alone = self._picked is not None and not modifiers & (SHIFT | CTRL)
        if alone and self._picked in handles.posed:
            self._set_pin(self._picked, False)
            return
        if alone:
            handles.select([self._picked])
        self.told.log("select", vertices=handles.selected)

    def wheel(self, notches) -> bool:
        handles = self.scene.handles
        if self.mode != "grab" or handles.grabbed is None:
            return False
        handles.widen(WIDER_PER_NOTCH**notches)
        self.told.say(f"grab radius {self.scene.settings.grab_radius:.2f} of the size")
        return True

    def cancel(self) -> None:
        handles = self.scene.handles
        if self.mode == "grab" and handles.grabbed is not None:
            vertex = handles.grabbed.handles[0]
            handles.cancel()
            self.told.log("cancel", vertex=vertex)

    def end(self) -> None:
        self.mode, self.dragging, self.spot = "", None, None
        self._picked = self._pin = None

    # -- a drag --------------------------------------------------------------------------

    def _grab_place(self):
        """Begin the drag of the place on which the button went down."""
        place, self.spot = self.spot, None
        if self._has_room():
            handles = self.scene.handles
            handles.grab_place(place)
            self._begin_drag(handles.grabbed.handles[0])

    def grab(self, handle) -> None:
        """Begin the drag of a handle on which the button went down."""
        handles = self.scene.handles
        if handle not in handles.selected:
            handles.select([])
        handles.grab(handle)
        handles.hover = handle
        self._begin_drag(handle)

    def _grab_selected(self):
        """Begin the drag of what is selected, as a gizmo or a key does."""
        self.scene.handles.grab_selected()
        self._begin_drag(self.scene.handles.grabbed.handles[0])

    def _begin_drag(self, handle):
        scene, view = self.scene, self.view
        (center,), _ = project(view.camera, self._place(handle)[None])
        held = Constraint(own=self._axes())
        self.dragging = drags.Drag(view.press_at, view.press_at - center, held=held)
        view.pointer = view.press_at
        self.mode = "grab"
        if scene.paused and scene.settings.hand != "pose":
            self.told.say(PAUSED)
        self.told.log("grab", vertex=handle, position=self._place(handle), pixel=center)

    def finish(self) -> None:
        handles = self.scene.handles
        if handles.grabbed is not None:
            vertex = handles.grabbed.handles[0]
            position = self._place(vertex)
            handles.let_go()
            if vertex in handles.posed:
                self.told.say(STAYS)
            self.scene.settings.has_dragged = True
            self.told.log("release", vertex=vertex, position=position)

    def pin(self) -> bool:
        """Pin what is held, where it is; else what is selected or under the mouse."""
        handles = self.scene.handles
        if self.mode == "grab":
            if handles.grabbed is not None:
                vertex = handles.grabbed.handles[0]
                handles.pin_grab()
                self.told.log("pin", vertex=vertex, position=self._place(vertex))
            return True
        chosen = handles.selected or [one for one in [handles.hover] if one is not None]
        if not chosen:
            self.told.say("nothing to pin: select red points, or point at one")
            return False
        free = [one for one in chosen if one in handles.posed or not handles.is_pinned(one)]
        handles.set_pins(free or chosen, bool(free))
        self.told.log("pin" if free else "free", vertex=chosen[0])
        return False

    def _place(self, handle):
        return self.scene.handles.at([handle])[0]

    def _set_pin(self, vertex, pinned):
        self.scene.handles.set_pin(vertex, pinned)
        self.told.log("pin" if pinned else "free", vertex=vertex)

    # -- by keys and by the gizmo --------------------------------------------------------

    @property
    def gizmo(self):
        scene, settings = self.scene, self.scene.settings
        ids = scene.handles.takeable if settings.show_handles and settings.gizmo != "off" else []
        if not ids:
            return None
        axes = self._axes() if settings.own_axes else np.eye(3)
        return Gizmo(settings.gizmo, scene.handles.at(ids).mean(axis=0), axes)

    def has_before_gizmo(self, pixel) -> bool:
        return self.pick(pixel) is not None

    def _axes(self):
        """What has become of model space's axes where the selection is, in columns.  [3, 3]"""
        scene, handles = self.scene, self.scene.handles
        held = handles.takeable if handles.grabbed is None else handles.grabbed.handles
        if not held:
            return np.eye(3)
        ids = np.unique(np.concatenate([handles.corners(one) for one in held]))
        if len(ids) < 4:  # single vertices: freed pins
            ids = handles.patch(held[0], scene.grab_radius)
        return best_rotation(scene.field.mesh.rest_vertices[ids], scene.positions[ids])

    @property
    def held_drag(self):
        held = self.mode == "grab" and self.scene.handles.grabbed is not None
        return self.dragging if held else None

    @property
    def drag_place(self):
        motion, drag = self.scene.handles.grabbed.target, self.dragging
        return motion.place + (drag.anchor if drag.kind == MOVE else motion.center)

    def follow(self, pixel) -> None:
        if self.held_drag is not None:  # a reset lets go while a button is down
            drags.follow(
                self.dragging, self.scene.handles, self.view.camera, pixel, self.view.ratio
            )

    def take(self, kind) -> bool:
        handles = self.scene.handles
        chosen = handles.takeable if self.scene.settings.show_handles else []
        if chosen and not drags.is_ahead(self.view.camera, handles.at(chosen).mean(axis=0)):
            self.told.say(drags.BEHIND)
        elif chosen:
            self._grab_selected()
        elif handles.hover in handles.control_ids:
            self.grab(handles.hover)
        elif self.spot is not None:
            self._grab_place()
        else:
            self.told.say(drags.NOTHING.format(kind))
        if self.mode != "grab":
            return False
        self._hold(kind, self.view.pointer)
        return True

    def take_part(self, kind) -> bool:
        self._grab_selected()
        self._hold(kind, self.view.press_at)
        return True

    def _hold(self, kind, pixel):
        """Let what was grabbed go by its middle from now on, which the mouse has at a pixel [2]."""
        motion, drag = self.scene.handles.grabbed.target, self.dragging
        middle = motion.place + motion.center
        drag.anchor, drag.miss = motion.center, drags.miss_of(self.view.camera, pixel, middle)
        drag.begin(kind, motion, pixel)

    def turn_into(self, kind) -> None:
        motion, drag, view = self.scene.handles.grabbed.target, self.dragging, self.view
        kind = MOVE if drag.kind == kind else kind
        drag.begin(kind, motion, view.pointer)
        if kind == MOVE:
            drag.miss = drags.miss_of(view.camera, view.pointer, motion.place + drag.anchor)
