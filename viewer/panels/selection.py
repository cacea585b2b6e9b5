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


def gesture_overlay(app) -> None:
    """Draw what the gesture in progress needs, beneath the panels."""
    controls = app.controls
    lines = imgui.get_background_draw_list()
    if controls.mode == "box":
        (x0, y0), (x1, y1) = (pixel / controls.ratio for pixel in controls.region)
        lines.add_rect_filled((x0, y0), (x1, y1), LINE(FILL))
        lines.add_rect((x0, y0), (x1, y1), LINE(OUTLINE))
    elif controls.mode == "lasso":
        points = [tuple(pixel / controls.ratio) for pixel in controls.region]
        for start, end in zip(points, [*points[1:], points[0]], strict=True):
            lines.add_line(start, end, LINE(OUTLINE), 1.5)
    elif controls.mode == "grab" and controls.dragging.axis is not None:
        _axis_line(app, lines)
    elif not controls.mode and controls.spot is not None and not app.gui.mouse_on_panel:
        _reach(app, lines)


def _reach(app, lines):
    """What a drag from under the mouse would take along, faintly."""
    controls, camera, place = app.controls, app.controls.camera, app.controls.spot
    beside = place + app.scene.grab_radius * camera.camera_to_world[:3, 0]
    pixels, _ = project(camera, np.array([place, beside]))
    if np.isfinite(pixels).all():
        center, edge = pixels / controls.ratio
        radius = max(float(np.linalg.norm(edge - center)), LEAST_REACH)
        lines.add_circle_filled(tuple(center), radius, LINE(REACH))
        lines.add_circle(tuple(center), radius, LINE(REACH_EDGE), 0, 1.5)


def _axis_line(app, lines):
    controls, scene = app.controls, app.scene
    if scene.handles.grabbed is None:
        return
    motion, axis = scene.handles.grabbed.target, controls.dragging.axis
    along = AXIS_LENGTH * scene.size * np.eye(3)[axis]
    places = motion.place + np.linspace(-1.0, 1.0, 33)[:, None] * along
    pixels, _ = project(controls.camera, places)
    points = pixels[np.isfinite(pixels).all(axis=1)] / controls.ratio
    for start, end in pairwise(points):
        lines.add_line(tuple(start), tuple(end), LINE(AXES[axis]), 1.5)
