"""The mouse: from the window's events to camera moves, selections and drags of handles.

The window calls the methods on_* with pyglet's positions (points, y up).  Pixels are the
image's: x to the right, y down.
"""

import time
from collections.abc import Callable

import numpy as np

from ..camera import (
    Covered,
    camera_of,
    in_free_part,
    onto_view_plane,
    panned,
    pick_sphere,
    project,
    ray,
    turned,
    visible,
    within,
    zoomed,
)
from ..document import MOST_ADDED
from ..settings import DELETING, OF_BONES, ORBIT_KEYS
from . import drags
from .bone_tool import BoneTool
from .constraints import Constraint
from .deleting import BRUSH, Stroke, delete_region, end_stroke, outline_of, widen_brush
from .drag_keys import DragKeys
from .gizmo import own_axes
from .inputs import ALT, CTRL, LEFT, MIDDLE, RIGHT, SHIFT
from .under_mouse import nearest_zoom, surface_at

ORBITS = dict(zip(ORBIT_KEYS, (ALT, CTRL, SHIFT), strict=True))
PAINTED = {"stiffen": 1.2, "soften": 1.0 / 1.2}  # factors of stiffness at each event of the mouse
ZOOM_PER_NOTCH = 0.88
PAUSED = "paused: it follows when time goes on (Space), by a step (.), or in Pose (N)"
PAUSED_BALL = "paused: the ball pushes when time goes on (Space), or by a step (.)"
STAYS = "it stays there; a click on the golden point lets it go"
CLICK_SLACK = 3.0  # points that the mouse may move during a click
PICK_SLACK = 5.0  # points around a sphere that still count as on it
DOUBLE_CLICK = 0.4  # s between two presses at one place
WIDER_PER_NOTCH = 1.15  # the grab radius, during a drag
REGIONS = "box", "lasso"
HOW = {0: "replace", SHIFT: "add", CTRL: "remove", SHIFT | CTRL: "intersect"}  # with a region


class Controls(DragKeys):
    """The mouse's gesture, from one event to the next."""

    def __init__(self, scene, depth_image: Callable, log: Callable, say: Callable = print):
        """Take the scene, a function that returns the depth image or None, and the event log.

        `say` shows a message to the user.
        """
        self.scene = scene
        # While a button is held: orbit, pan, pick, grab, push, paint, box, lasso, delete, bone or
        # gizmo.
        self.mode = ""
        self.free = False  # a drag goes on without a button: a click ends it,
        self.finishes = False  # or that it has come where a number sends it
        self.part = None  # of the gizmo, under the mouse or the button
        self.dragging: drags.Drag | None = None  # of handles
        self.region = []  # pixels of the box's corners, or of the lasso
        self.size = (1, 1)  # of the image
        self.ratio = 1.0  # image pixels per point
        self.covered = Covered()  # by panels
        self._depth_image = depth_image
        self._log, self._say = log, say
        self._button = 0
        self._miss = np.zeros(2)  # from the center of the ball to the press
        self._press = np.zeros(2)  # where the button went down
        self._picked = self._pin = None  # a handle that a drag would grab, a pin that a click frees
        self.pointer = np.zeros(2)  # where the mouse is
        self.spot = None  # of the surface, where a drag from here would take hold  [3]
        self._stroke: Stroke | None = None  # of the brush that deletes
        self._before = -np.inf, np.zeros(2)  # when and where a button went down before
        self._factor = 1.0  # of the stiffness, of what is being painted
        self.bones = BoneTool(scene, depth_image, log, say)

    @property
    def camera(self):
        return in_free_part(camera_of(self.scene.orbit, *self.size), self.covered, self.ratio)

    def _pixel(self, x, y):
        """From a position in the window to the middle of the image's pixel.  [2]"""
        return np.array([(x + 0.5) * self.ratio, self.size[1] - (y + 0.5) * self.ratio])

    # -- the window's events -------------------------------------------------------------

    def on_mouse_motion(self, x, y, dx, dy):
        pixel = self.pointer = self._pixel(x, y)
        if self.free:
            self.follow(pixel)
        if self.mode:
            return
        self.part = self.gizmo_part_at(pixel)
        if self.part is not None or self.scene.settings.tool in OF_BONES:
            self.scene.handles.hover = self.spot = None
        else:
            control = self.pick(pixel)
            pin = self.pick(pixel, self.scene.handles.pin_ids) if control is None else None
            self.scene.handles.hover = found = pin if control is None else control
            self.spot = self._place_under(pixel) if found is None else None

    def on_mouse_press(self, x, y, button, modifiers):
        if self.mode:  # a second button does not interrupt what the first one does,
            if button == RIGHT and self.mode in ("grab", "bone", "gizmo"):  # but takes it back
                self.cancel()
            elif button == LEFT and self.free:
                self.pointer = self._pixel(x, y)
                self.follow(self.pointer)
                self.finish()
            return
        if button not in (LEFT, MIDDLE, RIGHT):
            return
        self._button, self.spot = button, None
        pixel = self._press = self.pointer = self._pixel(x, y)
        takes = button == LEFT and not modifiers & ORBITS[self.scene.settings.orbit_key]
        self.part = self.gizmo_part_at(pixel) if takes else None
        if button != LEFT:
            orbits = button == MIDDLE and not modifiers & SHIFT
            self.mode = "orbit" if orbits and self.scene.settings.keys == "blender" else "pan"
        elif self.part is not None:
            self.mode = "gizmo"
        else:
            self._press_beside_gizmo(pixel, modifiers)

    def _press_beside_gizmo(self, pixel, modifiers):
        """The left button went down, and not on the gizmo, or for a click through it."""
        tool = self.scene.settings.tool
        if tool == "push":
            self._push(pixel)
        elif tool in PAINTED:
            self.mode, self._factor = "paint", PAINTED[tool]
            self._paint(pixel)
        elif tool == BRUSH:
            self._begin_stroke(pixel, bool(modifiers & SHIFT))
        elif tool in REGIONS or tool in DELETING:
            self.mode, self.region = tool.split()[-1], [pixel, pixel]
        elif tool in OF_BONES:
            self.mode = "bone" if self.bones.press(self.camera, pixel, self.ratio) else "orbit"
        else:
            self._press_on(self.pick(pixel), pixel, modifiers)

    def _press_on(self, handle, pixel, modifiers):
        """The left button went down on a handle, or beside all of them."""
        handles = self.scene.handles
        if handle is None:
            self.mode = "orbit"
            pin = self.pick(pixel, handles.pin_ids)
            self._pin = pin
            if pin is None and self._is_second(pixel):
                self._add_point(pixel)
            elif pin is None and not modifiers & ORBITS[self.scene.settings.orbit_key]:
                self.spot = self._place_under(pixel)
            return
        self.mode, self._picked = "pick", handle
        if modifiers & (SHIFT | CTRL):
            handles.select([handle], "toggle" if modifiers & SHIFT else "remove")
            self._picked = handle if handle in handles.selected else None

    def _is_second(self, pixel):
        """Whether a press is the second one of a double click."""
        (since, place), now = self._before, time.monotonic()
        near = np.linalg.norm(pixel - place) <= CLICK_SLACK * self.ratio
        self._before = now, pixel
        return near and now - since < DOUBLE_CLICK

    def on_mouse_drag(self, x, y, dx, dy, buttons, modifiers):
        scene, pixel, before = self.scene, self._pixel(x, y), self.pointer
        self.pointer = pixel
        clicking = np.linalg.norm(pixel - self._press) <= CLICK_SLACK * self.ratio
        if self.mode == "pick":
            if clicking or self._picked is None:
                return
            self._grab(self._picked)
        if self.spot is not None:
            if clicking:
                return
            self._grab_place()
        if self._pin is not None:
            if clicking:
                return
            self._pin = None
        if self.mode == "gizmo":
            if clicking:
                return
            self.take_part()
        if self.mode == "bone":
            if self.bones.drag is not None and not (clicking and self.bones.drag.start is None):
                self.follow(pixel)
        elif self.mode == "push":
            if scene.ball is not None:
                center = scene.ball.target
                scene.push_to(onto_view_plane(self.camera, pixel - self._miss, center))
        elif self.mode == "paint":
            self._paint(pixel)
        elif self.mode == "delete":
            self._stroke.move(before, pixel, self.brush_radius)
        elif self.mode == "grab":
            self.follow(pixel)
        elif self.mode == "box":
            self.region = [self._press, pixel]
        elif self.mode == "lasso":
            self.region.append(pixel)
        elif self.mode:
            move = turned if self.mode == "orbit" else panned
            scale = self.camera.focal / camera_of(scene.orbit, *self.size).focal
            height = self.size[1] * (scale if self.mode == "pan" else 1.0)
            scene.orbit = move(scene.orbit, dx * self.ratio, -dy * self.ratio, height)

    def on_mouse_release(self, x, y, button, modifiers):
        if button != self._button:
            return
        scene, handles = self.scene, self.scene.handles
        near = np.linalg.norm(self._pixel(x, y) - self._press) <= CLICK_SLACK * self.ratio
        clicked = near and button == LEFT
        if self.mode == "gizmo":
            self._press_beside_gizmo(self._press, modifiers)
        if self.mode == "push":
            scene.end_push()
            self._log("end_push")
        elif self.mode == "paint":
            self._log("paint", factors=scene.body.factors is not None)
        elif self.mode == "delete":
            self._say_deleted(end_stroke(scene))
        elif self.mode in ("grab", "bone"):
            self.finish()
        elif self.mode == "pick":
            self._end_click(modifiers)
        elif self.mode in REGIONS:
            self._end_region(modifiers)
        elif self._pin is not None:
            self._set_pin(self._pin, False)
        elif self.mode == "orbit" and clicked and scene.settings.tool == "joints":
            self.bones.click(self.camera, self._pixel(x, y))
        elif self.mode == "orbit" and clicked:
            if handles.selected:
                handles.select([])
                self._log("select", vertices=[])
        elif self.mode:
            orbit = scene.orbit
            self._log(self.mode, yaw=orbit.yaw, pitch=orbit.pitch, target=orbit.target)
        self._end()

    def finish(self) -> None:
        """End the drag in progress: what was dragged is let go where it is."""
        handles = self.scene.handles
        if self.mode == "bone":
            self.bones.release()
        elif handles.grabbed is not None:
            vertex = handles.grabbed.handles[0]
            position = self._place(vertex)
            handles.let_go()
            if vertex in handles.posed:
                self._say(STAYS)
            self.scene.settings.has_dragged = True
            self._log("release", vertex=vertex, position=position)
        self._end()

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
        self._log("select", vertices=handles.selected)

    def _end(self):
        self.mode, self._button, self.dragging, self.region = "", 0, None, []
        self._picked = self._pin = self._stroke = self.spot = self.part = None
        self.free = self.finishes = False

    def on_mouse_scroll(self, x, y, scroll_x, scroll_y):
        handles = self.scene.handles
        if self.mode == "grab" and handles.grabbed is not None:
            handles.widen(WIDER_PER_NOTCH**scroll_y)
            self._say(f"grab radius {self.scene.settings.grab_radius:.2f} of the size")
            return
        settings = self.scene.settings
        if settings.tool == BRUSH:
            widen_brush(settings, scroll_y)
            return
        scene, anchor = self.scene, self._surface_at(self._pixel(x, y))
        nearest = nearest_zoom(self.camera, self._depth_image(), anchor, scene.size)
        factor = max(ZOOM_PER_NOTCH**scroll_y, nearest)
        scene.orbit = zoomed(scene.orbit, factor, anchor)
        self._log("zoom", distance=scene.orbit.distance)

    def cancel(self) -> None:
        """Give up the gesture: what was dragged goes back to where it was taken from."""
        handles = self.scene.handles
        if self.mode == "push":
            self.scene.end_push()
        elif self.mode == "delete":
            self.scene.cuts.show_preview(None)
        elif self.mode == "grab" and handles.grabbed is not None:
            vertex = handles.grabbed.handles[0]
            handles.cancel()
            self._log("cancel", vertex=vertex)
        self.bones.cancel()
        if self.mode in ("push", "delete", "grab", "pick", "bone", "gizmo", *REGIONS):
            self._end()
        elif not self.mode and self.scene.settings.tool in (*REGIONS, *DELETING):
            self.scene.settings.tool = "grab"

    def pin(self) -> None:
        """Pin what is held, where it is; else what is selected or under the mouse."""
        handles = self.scene.handles
        if self.mode == "grab":
            if handles.grabbed is None:
                return
            vertex = handles.grabbed.handles[0]
            handles.pin_grab()
            self._log("pin", vertex=vertex, position=self._place(vertex))
            self._end()
            return
        chosen = handles.selected or [one for one in [handles.hover] if one is not None]
        if not chosen:
            self._say("nothing to pin: select red points, or point at one")
            return
        free = [one for one in chosen if one in handles.posed or not handles.is_pinned(one)]
        handles.set_pins(free or chosen, bool(free))
        self._log("pin" if free else "free", vertex=chosen[0])

    # -- what is under the mouse ---------------------------------------------------------

    def pick(self, pixel, ids=None) -> int | None:
        """The handle whose sphere shows there, of these (default: those that can be dragged)."""
        scene, slack = self.scene, PICK_SLACK * self.ratio
        if not scene.settings.show_handles:
            return None
        ids = scene.handles.control_ids if ids is None else ids
        surface = self._depth_image(), scene.handle_bias
        places = scene.handles.at(ids)
        found = pick_sphere(self.camera, pixel, places, scene.handle_radius, slack, *surface)
        return None if found is None else int(ids[found])

    def shown(self, ids):
        """Whether each of these vertices has a sphere in sight.  [len(ids)] bool"""
        scene = self.scene
        if not scene.settings.show_handles:
            return np.zeros(len(ids), bool)
        points = scene.handles.at(ids)
        return visible(self.camera, points, self._depth_image(), scene.handle_bias)

    def _surface_at(self, pixel, beside=True):
        """The object's point under a pixel; beside it, one as far away as its target, or None."""
        target = self.scene.orbit.target if beside else None
        return surface_at(self.camera, self._depth_image(), pixel, target)

    def _place_under(self, pixel):
        """The place of the object's surface that a drag from a pixel takes; None if it orbits."""
        settings = self.scene.settings
        if settings.tool != "grab" or not settings.grab_anywhere:
            return None
        return self._surface_at(pixel, beside=False)

    def _grab_place(self):
        """Begin the drag of the place on which the button went down."""
        place, self.spot = self.spot, None
        handles = self.scene.handles
        if len(handles.points) >= MOST_ADDED:
            self._say(f"{MOST_ADDED} red points are the most")
            return
        handles.grab_place(place)
        self._begin_drag(handles.grabbed.handles[0])

    def _grab(self, handle):
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
        scene = self.scene
        (center,), _ = project(self.camera, self._place(handle)[None])
        held = Constraint(own=own_axes(scene))
        self.dragging = drags.Drag(self._press, self._press - center, held=held)
        self.pointer = self._press
        self.mode = "grab"
        if scene.paused and scene.settings.hand != "pose":
            self._say(PAUSED)
        self._log("grab", vertex=handle, position=self._place(handle), pixel=center)

    @property
    def brush_radius(self) -> float:
        """Of the brush that deletes [pixels]."""
        return self.scene.settings.brush_radius * self.ratio

    def _begin_stroke(self, pixel, through):
        """Delete what is under the brush; beside the object the drag turns the view."""
        self._stroke = Stroke(self.scene, self.camera, self._depth_image(), through)
        if self._stroke.touches(pixel, self.brush_radius):
            self.mode = "delete"
            self._stroke.move(pixel, pixel, self.brush_radius)
        else:
            self.mode, self._stroke = "orbit", None

    def _end_region(self, modifiers):
        """A box or lasso is drawn: delete, or select, what is in it."""
        outline = outline_of(self.mode, self.region)
        if self.scene.settings.tool in DELETING:
            others = bool(modifiers & CTRL)
            self._say_deleted(delete_region(self.scene, self.camera, outline, others))
        else:
            self._select_region(outline, HOW[modifiers & (SHIFT | CTRL)])

    def _say_deleted(self, line):
        self._say(line)
        self._log("delete", left=int(self.scene.cuts.kept.sum()))

    def _select_region(self, outline, how):
        """Select the spheres in sight whose centers are in an outline."""
        handles = self.scene.handles
        ids = handles.control_ids
        pixels, _ = project(self.camera, handles.at(ids))
        handles.select(ids[self.shown(ids) & within(pixels, outline)], how)
        self.scene.settings.tool = "grab"
        self._log("select", vertices=handles.selected)

    def _add_point(self, pixel):
        """Make a control point on the surface under the mouse."""
        point = self._surface_at(pixel, beside=False)
        if len(self.scene.handles.points) >= MOST_ADDED:
            self._say(f"{MOST_ADDED} red points are the most")
        elif point is not None:
            handle = self.scene.handles.add_point(point)
            self.mode, self._picked = "pick", handle  # a drag from here takes it
            self._log("add_point", vertex=handle, position=point)

    def _push(self, pixel):
        """Put the ball on the surface under the mouse."""
        scene, point = self.scene, self._surface_at(pixel)
        if scene.timeline.stands:  # at a pose of the timeline: a hand lets time go on
            scene.paused = False
        if scene.paused:
            self._say(PAUSED_BALL)
        scene.push(point, -ray(self.camera, pixel)[1])
        (center,), _ = project(self.camera, scene.ball.target[None])
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
