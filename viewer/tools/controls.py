"""The hand: gives the window's events to the tool in it, to the camera, to the gizmo and to drags.

The window calls the methods on_* with pyglet's positions (points, y up).  Pixels are the
image's: x to the right, y down.  Keys begin a drag without a button, hold it to an axis, type a
number, and end it.
"""

from collections.abc import Callable

import numpy as np

from ..camera import pick_sphere, visible, zoomed
from ..settings import shows_points
from .bend import ORBITS, Bend
from .bone_tool import BoneTool, JointTool
from .brushes import BRUSH, DeleteBrush, DeleteRegion, Paint, Push, SelectRegion
from .drags import LONGEST_NUMBER, NOTHING, SCALE, TURN, number_of
from .gizmo import RING_STEP, Gizmo, Part, part_at, parts_of
from .isolate import Isolate
from .keys import ALT, CTRL, LEFT, MIDDLE, OTHER_NAMES, RIGHT, SHIFT, key_name
from .tool import CameraMove, DragTool, Tool
from .viewport import Viewport

# In the order of their buttons; the name is the value of Settings.tool, one of TOOLS.  What it is
# called, in full and in a word, and the name of a glyph are its button's.
KINDS_OF_TOOL = (
    (Bend, "grab", "Bend", "Bend", "hand_pointer"),
    (SelectRegion, "box", "Select in a box", "Select", "vector_square"),
    (SelectRegion, "lasso", "Select in a lasso", "Lasso", "draw_polygon"),
    (Push, "push", "Push with a ball", "Push", "bowling_ball"),
    (Paint, "stiffen", "Stiffen", "Stiffen", "gem"),
    (Paint, "soften", "Soften", "Soften", "feather"),
    (DeleteBrush, BRUSH, "Delete with a brush", "Erase", "eraser"),
    (DeleteRegion, "delete box", "Delete in a box", "Cut box", "square_minus"),
    (DeleteRegion, "delete lasso", "Delete in a lasso", "Cut lasso", "scissors"),
    (Isolate, "isolate", "Isolate one thing", "Isolate", "object_ungroup"),
    (JointTool, "joints", "Place joints", "Joints", "circle_nodes"),
    (BoneTool, "bones", "Pose bones", "Bones", "bone"),
)
PICK_SLACK = 5.0  # points around a sphere that still count as on it
ZOOM_PER_NOTCH = 0.88
FREE = "{}: the mouse, or a number; X Y Z: along an axis; click or Enter: done; Esc: back"
FLAT = 0.5  # the cosine of the least angle of a ring to the view at which the mouse goes around it
LEAST_WAY = 40.0  # points for a radian
OF_NUMBERS = {"MINUS", "PERIOD", "COMMA", "NUM_SUBTRACT", "NUM_DECIMAL"}  # keys, but for digits


class Controls(Viewport):
    """The mouse on one scene, from one event to the next.

    Attributes:
        tools: All tools, by their names.
        holder: What has the mouse while a button is down, or a drag goes on without one.
        part: Of the gizmo, under the mouse or the button.
        free: Whether a drag goes on without a button: a click ends it,
        finishes: or that it has come where a number sends it.
    """

    def __init__(self, scene, depth_image: Callable, log: Callable, say: Callable = print):
        """Take the scene, a function that returns the depth image or None, and the event log.

        `say` shows a message to the user.
        """
        super().__init__(scene.viewpoint, depth_image)
        self.scene, self.log, self.say = scene, log, say
        self.tools: dict[str, Tool] = {row[1]: row[0](self) for row in KINDS_OF_TOOL}
        for tool, row in zip(self.tools.values(), KINDS_OF_TOOL, strict=True):
            _, tool.name, tool.title, tool.word, tool.icon = row
        self._camera_move, self._nobody = CameraMove(self), Tool(self)
        self._nobody.can_cancel = False
        self.holder: Tool = self._nobody
        self.part: Part | None = None
        self.free = self.finishes = self._on_part = False
        self._button = 0
        scene.rigging.say = say

    # -- what is in the hand -------------------------------------------------------------

    @property
    def tool(self) -> Tool:
        """The tool in the hand."""
        return self.tools[self.scene.settings.tool]

    def take_tool(self, name: str) -> None:
        """Take another tool into the hand."""
        if self.free:
            self.cancel()
        self.scene.settings.tool = name

    @property
    def mode(self) -> str:
        """What the mouse does now: empty, or "orbit", "pan", "gizmo" or what the tool says."""
        return "gizmo" if self._on_part else self.holder.mode

    @property
    def bones(self) -> BoneTool:
        """The tool that has, or would have, a joint or a bone."""
        return self.tools["joints" if self.scene.settings.tool == "joints" else "bones"]

    def leave(self) -> None:
        """The mouse is over a panel: nothing of the view is under it."""
        self.part = None
        self.tools["grab"].leave()

    def shown(self, ids):
        """Whether each of these handles has a sphere in sight.  [len(ids)] bool"""
        scene = self.scene
        if not shows_points(scene.settings):
            return np.zeros(len(ids), bool)
        return visible(self.camera, scene.handles.at(ids), self.depth_image(), scene.handle_bias)

    def pick(self, pixel, ids=None) -> int | None:
        """The handle whose sphere shows there, of these (default: those that can be dragged)."""
        scene = self.scene
        if not shows_points(scene.settings):
            return None
        ids = scene.handles.control_ids if ids is None else ids
        surface, slack = (self.depth_image(), scene.handle_bias), PICK_SLACK * self.ratio
        places, radius = scene.handles.at(ids), scene.handle_radius
        found = pick_sphere(self.camera, pixel, places, radius, slack, *surface)
        return None if found is None else int(ids[found])

    # -- the window's events -------------------------------------------------------------

    def on_mouse_motion(self, x, y, dx, dy):
        pixel = self.pointer = self.pixel(x, y)
        if self.free:
            self.follow(pixel)
        if self.mode:
            return
        self.part = self.gizmo_part_at(pixel)
        if self.part is not None or self.tool.name != "grab":
            self.tools["grab"].leave()
        if self.part is None:
            self.tool.hover(pixel)

    def on_mouse_press(self, x, y, button, modifiers):
        if self.mode:  # a second button does not interrupt what the first one does,
            if button == RIGHT and self.mode in ("grab", "bone", "gizmo"):  # but takes it back
                self.cancel()
            elif button == LEFT and self.free:
                self.pointer = self.pixel(x, y)
                self.follow(self.pointer)
                self.finish()
            return
        if button not in (LEFT, MIDDLE, RIGHT):
            return
        self._button = button
        pixel = self.press_at = self.pointer = self.pixel(x, y)
        settings = self.scene.settings
        takes = button == LEFT and not modifiers & ORBITS[settings.orbit_key]
        self.part = self.gizmo_part_at(pixel) if takes else None
        self._on_part = self.part is not None
        if button != LEFT:
            orbits = button == MIDDLE and not modifiers & SHIFT and settings.keys == "blender"
            self._move_camera("orbit" if orbits else "pan")
        elif not self._on_part:
            self._press(pixel, modifiers)

    def _press(self, pixel, modifiers):
        """The left button went down, and not on the gizmo, or for a click through it."""
        tool = self.tool
        if tool.press(pixel, modifiers):
            self.holder = tool
        else:
            tool.end()
            self._move_camera("orbit")

    def _move_camera(self, mode):
        self.tools["grab"].spot = None
        self.holder, self._camera_move.mode = self._camera_move, mode

    def on_mouse_drag(self, x, y, dx, dy, buttons, modifiers):
        pixel, before = self.pixel(x, y), self.pointer
        self.pointer, clicking = pixel, self.clicks(pixel)
        if self._on_part:
            if clicking:
                return
            self._take_part()
        holder = self.holder
        if not (clicking and holder.waits) and not holder.move(before, pixel):
            holder.end()
            self._move_camera("orbit")
            self.holder.move(before, pixel)

    def on_mouse_release(self, x, y, button, modifiers):
        if button != self._button:
            return
        pixel = self.pixel(x, y)
        clicked = self.clicks(pixel) and button == LEFT
        if self._on_part:  # a click through the gizmo
            self._on_part = False
            self._press(self.press_at, modifiers)
        holder = self.holder
        if holder is self._camera_move and clicked and holder.mode == "orbit":
            self.tool.click(pixel)
        else:
            holder.release(pixel, clicked, modifiers)
        self._end()

    def finish(self) -> None:
        """End the drag in progress: what was dragged is let go where it is."""
        if self.held_drag is not None:
            self.holder.finish()
        self._end()

    def _end(self):
        self.holder.end()
        self.holder, self.part, self._button = self._nobody, None, 0
        self.free = self.finishes = self._on_part = False

    def on_mouse_scroll(self, x, y, scroll_x, scroll_y):
        if (self.tool if self.holder is self._nobody else self.holder).wheel(scroll_y):
            return
        anchor = self.surface_at(self.pixel(x, y))
        nearest = 1.0 - self.gap(self.scene.size) / np.linalg.norm(anchor - self.camera.position)
        factor = max(ZOOM_PER_NOTCH**scroll_y, nearest)  # inside the object, all is white
        self.viewpoint.orbit = zoomed(self.viewpoint.orbit, factor, anchor)
        self.log("zoom", distance=self.viewpoint.orbit.distance)

    def on_key_press(self, symbol, modifiers):
        """Keys of numbers are a drag's as long as it goes on, and Enter, which ends a free one."""
        name = key_name(symbol)
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

    # -- gestures ------------------------------------------------------------------------

    def cancel(self) -> None:
        """Give up the gesture: what was dragged goes back to where it was taken from."""
        if self._on_part:
            self._end()
        elif self.holder.can_cancel:
            self.holder.cancel()
            self._end()

    @property
    def undoes(self) -> str | None:
        """What `undo` would take back, of the tool's own or of the object's steps."""
        return self.tool.undoes or self.scene.journal.undoes

    @property
    def redoes(self) -> str | None:
        return self.tool.redoes or self.scene.journal.redoes

    def undo(self) -> str | None:
        """Take back the drag in progress, else the last step.  Returns which, or None."""
        scene, journal = self.scene, self.scene.journal
        count = journal.cursor
        self.cancel()
        if journal.cursor < count:  # a drag's step, which is all that is taken back
            return "drag"
        label, undoing = self.undoes, self.tool if self.tool.undoes else scene
        return label if undoing.undo() else None

    def redo(self) -> str | None:
        """Do the step again that was undone last; returns which.  None: there is none."""
        self.cancel()
        label, redoing = self.redoes, self.tool if self.tool.redoes else self.scene
        return label if redoing.redo() else None

    def reset(self) -> None:
        """Give up the gesture, and reset the deformation."""
        self.cancel()
        self.scene.reset()

    def escape(self) -> None:
        """Give up the gesture; without one, put the tool away."""
        if self.mode:
            self.cancel()
        else:
            self.scene.settings.tool = "grab"

    def grab(self, handle: int) -> None:
        """Begin the drag of a handle where the mouse is."""
        self.press_at = self.pointer
        self.holder = self.tools["grab"]
        self.holder.grab(handle)

    def pin(self) -> None:
        """Pin what is held, where it is; else what is selected or under the mouse."""
        if self.tools["grab"].pin():
            self._end()

    # -- a drag in progress --------------------------------------------------------------

    @property
    def held_drag(self):
        """The Drag or BoneDrag in progress, or None."""
        return self.holder.held_drag

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
