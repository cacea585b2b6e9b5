"""The mouse: hands the window's events to the tool in the hand, to the camera and to the gizmo.

The window calls the methods on_* with pyglet's positions (points, y up).  Pixels are the
image's: x to the right, y down.
"""

from collections.abc import Callable

import numpy as np

from ..camera import pick_sphere, visible, zoomed
from .bend import ORBITS, Bend
from .bone_tool import JointTool, PoseTool
from .brushes import DeleteBrush, Push, Soften, Stiffen
from .drag_keys import DragKeys
from .gizmo import Part
from .isolate import Isolate
from .keys import LEFT, MIDDLE, RIGHT, SHIFT
from .regions import DeleteBox, DeleteLasso, SelectBox, SelectLasso
from .tool import CameraMove, Tool
from .viewport import Viewport

KINDS_OF_TOOL = (  # in the order of their buttons
    *(Bend, SelectBox, SelectLasso, Push, Stiffen, Soften),
    *(DeleteBrush, DeleteBox, DeleteLasso, Isolate, JointTool, PoseTool),
)
PICK_SLACK = 5.0  # points around a sphere that still count as on it
ZOOM_PER_NOTCH = 0.88


class Controls(DragKeys, Viewport):
    """The mouse on one scene, from one event to the next.

    Attributes:
        tools: All tools, by their names.
        holder: What has the mouse while a button is down, or a drag goes on without one; or None.
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
        self.tools: dict[str, Tool] = {kind.name: kind(self) for kind in KINDS_OF_TOOL}
        self._camera_move = CameraMove(self)
        self.holder: Tool | None = None
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
        if self._on_part:
            return "gizmo"
        return "" if self.holder is None else self.holder.mode

    @property
    def spot(self):
        """Of the surface, where a drag from under the mouse would take hold; or None.  [3]"""
        return self.tools["grab"].spot

    @property
    def region(self):
        """Pixels of the corners of the box that is drawn, or of the lasso."""
        return getattr(self.holder, "region", ())

    @property
    def bones(self) -> JointTool | PoseTool:
        """The tool that has, or would have, a joint or a bone."""
        return self.tools["joints" if self.scene.settings.tool == "joints" else "bones"]

    def leave(self) -> None:
        """The mouse is over a panel: nothing of the view is under it."""
        self.part = None
        self.tools["grab"].leave()

    def shown(self, ids):
        """Whether each of these handles has a sphere in sight.  [len(ids)] bool"""
        scene = self.scene
        if not scene.settings.show_handles:
            return np.zeros(len(ids), bool)
        return visible(self.camera, scene.handles.at(ids), self.depth_image(), scene.handle_bias)

    def pick(self, pixel, ids=None) -> int | None:
        """The handle whose sphere shows there, of these (default: those that can be dragged)."""
        scene = self.scene
        if not scene.settings.show_handles:
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
        if holder is None or (clicking and holder.waits):
            return
        if not holder.move(before, pixel):
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
        elif holder is not None:
            holder.release(pixel, clicked, modifiers)
        self._end()

    def finish(self) -> None:
        """End the drag in progress: what was dragged is let go where it is."""
        if self.held_drag is not None:
            self.holder.finish()
        self._end()

    def _end(self):
        if self.holder is not None:
            self.holder.end()
        self.holder, self.part, self._button = None, None, 0
        self.free = self.finishes = self._on_part = False

    def on_mouse_scroll(self, x, y, scroll_x, scroll_y):
        if (self.holder or self.tool).wheel(scroll_y):
            return
        anchor = self.surface_at(self.pixel(x, y))
        nearest = 1.0 - self.gap(self.scene.size) / np.linalg.norm(anchor - self.camera.position)
        factor = max(ZOOM_PER_NOTCH**scroll_y, nearest)  # inside the object, all is white
        self.viewpoint.orbit = zoomed(self.viewpoint.orbit, factor, anchor)
        self.log("zoom", distance=self.viewpoint.orbit.distance)

    def cancel(self) -> None:
        """Give up the gesture: what was dragged goes back to where it was taken from."""
        if self._on_part:
            self._end()
        elif self.holder is not None and self.holder.can_cancel:
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
        label = self.undoes
        if self.tool.undoes:
            self.tool.undo()
            return label
        return label if scene.undo() else None

    def redo(self) -> str | None:
        """Do the step again that was undone last; returns which.  None: there is none."""
        self.cancel()
        label = self.redoes
        if self.tool.redoes:
            self.tool.redo()
            return label
        return label if self.scene.redo() else None

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
