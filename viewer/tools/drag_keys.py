"""What keys do to a drag: begin one without a button, hold it to an axis, type a number, end it.

Pixels are the image's, x to the right, y down.
"""

import numpy as np

from .constraints import LONGEST_NUMBER, SCALE, TURN, number_of
from .drags import NOTHING
from .gizmo import RING_STEP, Gizmo, Part, part_at, parts_of
from .keys import ALT, CTRL, OTHER_NAMES
from .tool import DragTool

FREE = "{}: the mouse, or a number; X Y Z: along an axis; click or Enter: done; Esc: back"
FLAT = 0.5  # the cosine of the least angle of a ring to the view at which the mouse goes around it
LEAST_WAY = 40.0  # points for a radian
OF_NUMBERS = {"MINUS", "PERIOD", "COMMA", "NUM_SUBTRACT", "NUM_DECIMAL"}  # keys, but for digits


class DragKeys:
    """The part of Controls that keys call."""

    # -- a drag in progress --------------------------------------------------------------

    @property
    def held_drag(self):
        """The Drag or BoneDrag in progress, or None."""
        return None if self.holder is None else self.holder.held_drag

    @property
    def drag_place(self) -> np.ndarray:
        """Where what is dragged is: the point that the axes of the drag go through.  [3]"""
        return self.holder.drag_place

    def turn_into(self, kind: str) -> None:
        """Let the drag in progress move, turn or scale what is held; without one, begin it."""
        if self.held_drag is None:
            self._begin_free(kind)
        else:
            self.holder.turn_into(kind)

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
        if self.held_drag is not None:  # a reset lets go while a button is down
            self.holder.follow(pixel)

    # -- a drag without a button ---------------------------------------------------------

    def _begin_free(self, kind):
        """Move, turn or scale what is chosen, or under the mouse, until a click or Enter."""
        tool = self.tool
        if self.mode:
            self.say(f"{kind}: while you drag a red point")
        elif not isinstance(tool, DragTool):
            self.say(NOTHING.format(kind))
        else:
            self.press_at = self.pointer
            if tool.take(kind):
                self.holder, self.free = tool, True
                self.say(FREE.format(kind))

    def apply(self, text: str, axis: int) -> None:
        """Do at once what the gizmo does, by a number along an axis or about it."""
        gizmo, number = self.tool.gizmo, number_of(text)
        if number is None:
            self.say(f"{text[:LONGEST_NUMBER]!r} is no number")
        elif gizmo is not None and gizmo.kind == SCALE and number <= 0.0:
            self.say("a factor is more than 0")
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
        gizmo = self.tool.gizmo if self.mode in ("", "orbit", "pan", "gizmo") else None
        return [] if gizmo is None else parts_of(gizmo, self.camera, self.ratio)

    def gizmo_part_at(self, pixel) -> Part | None:
        """What of the gizmo is under the mouse; a red point or a joint there comes first."""
        parts = self.gizmo_parts()
        part = part_at(parts, pixel, self.ratio) if parts else None
        return None if part is None or self.tool.has_before_gizmo(pixel) else part

    def _take_part(self) -> None:
        """Begin the drag of the part of the gizmo on which the button went down."""
        tool, part, self._on_part = self.tool, self.part, False
        gizmo = tool.gizmo
        if gizmo is None or not tool.take(gizmo.kind):  # a key took the selection away
            return
        self.holder = tool
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
        nearest = int(np.linalg.norm(part.line - self.press_at, axis=1).argmin())
        before, after = max(nearest - 1, 0), min(nearest + 1, len(part.line) - 1)
        way = (part.line[after] - part.line[before]) / ((after - before) * RING_STEP)
        length = float(np.linalg.norm(way))  # where the ring turns back, a pixel would be much
        return way / length * max(length, LEAST_WAY * self.ratio) if length > 0.0 else None

    # -- the window's events -------------------------------------------------------------

    def on_key_press(self, symbol, modifiers):
        """Keys of numbers are a drag's as long as it goes on, and Enter, which ends a free one."""
        from pyglet.window import key  # not at the top: it needs a display, or headless mode

        name = key.symbol_string(symbol)
        if name in ("ENTER", "NUM_ENTER") and not self.mode and self.tool.enter():
            return True
        if self.held_drag is None or modifiers & (CTRL | ALT):
            return None
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
