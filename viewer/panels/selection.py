"""What the mouse shows over the view: a box or lasso, an axis, how much a drag would take."""

from itertools import pairwise

import numpy as np
from imgui_bundle import imgui

from ..camera import project

LINE = imgui.get_color_u32  # of a color, in the current style's opacity
OUTLINE, FILL = (0.95, 0.45, 0.05, 0.95), (0.95, 0.55, 0.1, 0.12)
AXES = (0.85, 0.15, 0.1, 0.9), (0.15, 0.6, 0.1, 0.9), (0.1, 0.3, 0.9, 0.9)
REACH, REACH_EDGE = (0.95, 0.10, 0.08, 0.10), (0.95, 0.10, 0.08, 0.35)
LEAST_REACH = 6.0  # points, of its radius
AXIS_LENGTH = 2.0  # object sizes, to both sides
TEXT, SHADE = (0.1, 0.1, 0.12, 1.0), (1.0, 1.0, 1.0, 0.9)
BESIDE = np.array([16.0, 14.0])  # points from the mouse to the text


def gesture_overlay(controls, gui, grab_radius, size) -> None:
    """Draw what the gesture in progress needs, beneath the panels."""
    lines = imgui.get_background_draw_list()
    if controls.mode == "box":
        (x0, y0), (x1, y1) = (pixel / controls.ratio for pixel in controls.region)
        lines.add_rect_filled((x0, y0), (x1, y1), LINE(FILL))
        lines.add_rect((x0, y0), (x1, y1), LINE(OUTLINE))
    elif controls.mode == "lasso":
        points = [tuple(pixel / controls.ratio) for pixel in controls.region]
        for start, end in zip(points, [*points[1:], points[0]], strict=True):
            lines.add_line(start, end, LINE(OUTLINE), 1.5)
    elif controls.held_drag is not None:
        _drag(controls, size, lines)
    elif not controls.mode and controls.spot is not None and not gui.mouse_on_panel:
        _reach(controls, grab_radius, lines)


def _reach(controls, grab_radius, lines):
    """What a drag from under the mouse would take along, faintly."""
    camera, place = controls.camera, controls.spot
    beside = place + grab_radius * camera.camera_to_world[:3, 0]
    pixels, _ = project(camera, np.array([place, beside]))
    if np.isfinite(pixels).all():
        center, edge = pixels / controls.ratio
        radius = max(float(np.linalg.norm(edge - center)), LEAST_REACH)
        lines.add_circle_filled(tuple(center), radius, LINE(REACH))
        lines.add_circle(tuple(center), radius, LINE(REACH_EDGE), 0, 1.5)


def _drag(controls, size, lines):
    """The axes that a drag is held to, and beside the mouse how far it has come."""
    drag = controls.held_drag
    for axis in range(3) if drag.held.axis is not None else ():
        if drag.held.across != (axis == drag.held.axis):
            _axis_line(controls, size, lines, axis)
    if controls.free or not drag.is_plain:
        x, y = controls.pointer / controls.ratio + BESIDE
        for shift, color in ((1.0, SHADE), (0.0, TEXT)):
            lines.add_text((x + shift, y + shift), LINE(color), drag.line)


def _axis_line(controls, size, lines, axis):
    along = AXIS_LENGTH * size * controls.held_drag.held.axes[:, axis]
    places = controls.drag_place + np.linspace(-1.0, 1.0, 33)[:, None] * along
    pixels, _ = project(controls.camera, places)
    points = pixels[np.isfinite(pixels).all(axis=1)] / controls.ratio
    for start, end in pairwise(points):
        lines.add_line(tuple(start), tuple(end), LINE(AXES[axis]), 1.5)
