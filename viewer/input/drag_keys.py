"""What keys do to a drag: begin one without a button, hold it to an axis, type a number, end it.

Pixels are the image's, x to the right, y down.
"""

import numpy as np

from ..document import TAIL
from ..settings import OF_BONES
from . import drags
from .constraints import LONGEST_NUMBER, MOVE, SCALE, TURN, number_of
from .gizmo import RING_STEP, Gizmo, Part, gizmo_of, part_at, parts_of
from .inputs import ALT, CTRL, OTHER_NAMES

FREE = "{}: the mouse, or a number; X Y Z: along an axis; click or Enter: done; Esc: back"
NOTHING = "nothing to {}: select red points, or point at one"
FLAT = 0.5  # the cosine of the least angle of a ring to the view at which the mouse goes around it
LEAST_WAY = 40.0  # points for a radian
OF_NUMBERS = {"MINUS", "PERIOD", "COMMA", "NUM_SUBTRACT", "NUM_DECIMAL"}  # keys, but for digits


class DragKeys:
    """The part of Controls that keys call."""

    # -- a drag in progress --------------------------------------------------------------

    @property
    def held_drag(self):
        """The Drag or BoneDrag in progress, or None."""
        if self.mode == "grab" and self.scene.handles.grabbed is not None:
            return self.dragging
        return self.bones.drag if self.mode == "bone" else None

    @property
    def drag_place(self) -> np.ndarray:
        """Where what is dragged is: the point that the axes of the drag go through.  [3]"""
        if self.mode == "bone":
            drag = self.bones.drag
            if self.bones.place is not None or drag.joint.bone < 0:
                return drag.joint.place
            moves_tail = drag.kind == MOVE and drag.joint.end == TAIL
            return self.scene.posing.ends[drag.joint.bone, int(moves_tail)]
        motion, drag = self.scene.handles.grabbed.target, self.dragging
        return motion.place + (drag.anchor if drag.kind == MOVE else motion.center)

    def turn_into(self, kind: str) -> None:
        """Let the drag in progress move, turn or scale what is held; without one, begin it."""
        grab = self.scene.handles.grabbed
        if self.held_drag is None:
            self._begin_free(kind)
        elif self.mode == "grab":
            kind = MOVE if self.dragging.kind == kind else kind
            self.dragging.begin(kind, grab.target, self.pointer)
            if kind == MOVE:
                follows = grab.target.place + self.dragging.anchor
                self.dragging.miss = drags.miss_of(self.camera, self.pointer, follows)
        else:
            self.bones.turn_into(kind, self.camera, self.pointer)

    def along(self, axis: int, across: bool = False) -> None:
        """Let the drag in progress go along, or turn about, one axis; its own one; or any.

        Args:
            across: In the plane across it instead.
        """
        drag = self.held_drag
        if drag is not None:
            drag.held.choose(axis, across)
            self.follow(self.pointer)

    def type(self, character: str) -> bool:
        """Take a character of the number that says how far a drag goes; whether it is one."""
        taken = self.held_drag is not None and self.held_drag.held.type(character)
        if taken:
            self.follow(self.pointer)
        return taken

    def follow(self, pixel) -> None:
        """Send what is dragged to where the mouse is, or where a number says."""
        if self.held_drag is None:  # a reset lets go while a button is down
            return
        if self.mode == "bone":
            self.bones.move(self.camera, pixel, self.ratio)
        else:
            drags.follow(self.dragging, self.scene.handles, self.camera, pixel, self.ratio)

    # -- a drag without a button ---------------------------------------------------------

    def _begin_free(self, kind):
        """Move, turn or scale what is chosen, or under the mouse, until a click or Enter."""
        tool = self.scene.settings.tool
        if self.mode:
            self._say(f"{kind}: while you drag a red point")
            return
        if tool in OF_BONES:
            if self.bones.take(self.camera, self.pointer, kind):
                self.mode, self.free = "bone", True
        elif tool == "grab" and self._grab_chosen(kind):
            self.free = True
            self.hold(kind, self.pointer)
        elif tool != "grab":
            self._say(NOTHING.format(kind))
        if self.free:
            self._say(FREE.format(kind))

    def _grab_chosen(self, kind):
        """Take hold of what is selected, else of what is under the mouse; whether there is any."""
        handles, self._press = self.scene.handles, self.pointer
        chosen = handles.takeable if self.scene.settings.show_handles else []
        if chosen and not drags.is_ahead(self.camera, handles.at(chosen).mean(axis=0)):
            self._say(drags.BEHIND)
        elif chosen:
            self._grab_selected()
        elif handles.hover in handles.control_ids:
            self._grab(handles.hover)
        elif self.spot is not None:
            self._grab_place()
        else:
            self._say(NOTHING.format(kind))
        return self.mode == "grab"

    def hold(self, kind: str, pixel) -> None:
        """Let what was grabbed go by its middle from now on.

        Args:
            pixel: Where the mouse has it.  [2]
        """
        motion, drag = self.scene.handles.grabbed.target, self.dragging
        middle = motion.place + motion.center
        drag.anchor, drag.miss = motion.center, drags.miss_of(self.camera, pixel, middle)
        drag.begin(kind, motion, pixel)

    def apply(self, text: str, axis: int) -> None:
        """Do at once what the gizmo does, by a number along an axis or about it."""
        gizmo = gizmo_of(self.scene)
        number = number_of(text)
        if number is None:
            self._say(f"{text[:LONGEST_NUMBER]!r} is no number")
        elif gizmo is not None and gizmo.kind == SCALE and number <= 0.0:
            self._say("a factor is more than 0")
        elif gizmo is not None and not self.mode:
            self._begin_free(gizmo.kind)
        if self.free and self.held_drag is not None:
            held = self.held_drag.held
            held.axis, held.is_own, held.text = axis, self.scene.settings.own_axes, text.strip()
            self.follow(self.pointer)
            self.finishes = True

    def end_if_there(self) -> None:
        """End a drag that `apply` began, once what is held is where it was sent."""
        if self.finishes and not self.scene.handles.behind:
            self.finish()

    # -- the gizmo -----------------------------------------------------------------------

    def gizmo_parts(self) -> list[Part]:
        """What shows of the gizmo; nothing during a gesture of the hand."""
        gizmo = gizmo_of(self.scene) if self.mode in ("", "orbit", "pan", "gizmo") else None
        return [] if gizmo is None else parts_of(gizmo, self.camera, self.ratio)

    def gizmo_part_at(self, pixel) -> Part | None:
        """What of the gizmo is under the mouse; a red point or a joint there comes first."""
        parts = self.gizmo_parts()
        part = part_at(parts, pixel, self.ratio) if parts else None
        if part is not None and self.scene.settings.tool in OF_BONES:
            joint = self.bones.pick(self.camera, pixel, self.ratio)
            return part if joint is None or joint.end == "body" else None
        return part if part is None or self.pick(pixel) is None else None

    def take_part(self) -> None:
        """Begin the drag of the part of the gizmo on which the button went down."""
        gizmo, part = gizmo_of(self.scene), self.part
        if gizmo is None:  # a key took the selection away
            self.mode = ""
            return
        if self.scene.settings.tool not in OF_BONES:
            self._grab_selected()
            self.hold(gizmo.kind, self._press)
        elif self.bones.take(self.camera, self._press, gizmo.kind):
            self.mode = "bone"
        else:
            self.mode = ""
            return
        held = self.held_drag.held
        held.axis, held.across = part.axis, part.across
        held.is_own = self.scene.settings.own_axes and part.axis is not None
        if gizmo.kind == TURN and part.axis is not None:
            held.tangent = self._tangent(gizmo, part)

    def _tangent(self, gizmo: Gizmo, part):
        """Pixels per radian along a ring where it was pressed, if it is seen from its side."""
        axis, camera = gizmo.axes[:, part.axis], self.camera
        view = camera.forward if camera.parallel else gizmo.pivot - camera.position
        if abs(axis @ view) > FLAT * np.linalg.norm(view):
            return None
        nearest = int(np.linalg.norm(part.line - self._press, axis=1).argmin())
        before, after = max(nearest - 1, 0), min(nearest + 1, len(part.line) - 1)
        way = (part.line[after] - part.line[before]) / ((after - before) * RING_STEP)
        length = float(np.linalg.norm(way))  # where the ring turns back, a pixel would be much
        return way / length * max(length, LEAST_WAY * self.ratio) if length > 0.0 else None

    # -- the window's events -------------------------------------------------------------

    def on_key_press(self, symbol, modifiers):
        """Keys of numbers are a drag's as long as it goes on, and Enter, which ends a free one."""
        from pyglet.window import key  # not at the top: it needs a display, or headless mode

        if self.held_drag is None or modifiers & (CTRL | ALT):
            return None
        name = key.symbol_string(symbol)
        if name in ("ENTER", "NUM_ENTER") and (self.free or self.held_drag.held.text):
            self.finish()
            return True
        if name == "BACKSPACE":
            return self.type("\b")
        digit = OTHER_NAMES.get(name, name).removeprefix("_").isdigit()
        return digit or name in OF_NUMBERS or None

    def on_text(self, text):
        """Characters of a number; which key has them is a matter of the keyboard."""
        taken = [self.type(character) for character in text]
        return any(taken) or None
