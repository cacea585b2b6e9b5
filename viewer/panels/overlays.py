"""What is drawn over the view, beneath the panels: the gizmo, what the mouse does, a found box."""

from itertools import pairwise, product

import numpy as np
from imgui_bundle import imgui

from ..camera import depth_at, project
from ..tools import BRUSH, found_box

LINE = imgui.get_color_u32  # of a color, in the current style's opacity
OUTLINE, FILL = (0.95, 0.45, 0.05, 0.95), (0.95, 0.55, 0.1, 0.12)  # of a box or lasso
AXES = (0.85, 0.15, 0.1, 0.9), (0.15, 0.6, 0.1, 0.9), (0.1, 0.3, 0.9, 0.9)
AXIS_LENGTH = 2.0  # object sizes, to both sides
REACH, REACH_EDGE = (0.95, 0.10, 0.08, 0.10), (0.95, 0.10, 0.08, 0.35)
LEAST_REACH = 6.0  # points, of its radius
TEXT, SHADE = (0.1, 0.1, 0.12, 1.0), (1.0, 1.0, 1.0, 0.9)
BESIDE = np.array([16.0, 14.0])  # points from the mouse to the text
RING, RING_SHADE = (0.90, 0.12, 0.10, 0.95), (1.0, 1.0, 1.0, 0.6)  # of the brush

VIEW = (0.35, 0.36, 0.40, 0.9)  # what of the gizmo has no axis
CHOSEN = (1.0, 0.72, 0.05, 1.0)
EDGE = (1.0, 1.0, 1.0, 0.55)  # around the lines, so that they show on any picture
WIDTH, EDGE_WIDTH = 2.5, 4.5  # points
TIP = 6.0  # points, of an arrow's head, or half a box
FAINT = 0.45  # opacity of a square

SEEN, HIDDEN = (0.10, 0.45, 0.85, 0.95), (0.10, 0.45, 0.85, 0.30)  # of the box that was found
PIECES = 24  # of an edge, each in sight or not
EDGES = [  # pairs of corners, as product(range(2), repeat=3) counts them
    (i, i + step) for step in (4, 2, 1) for i in range(8) if not i & step
]
OUTSIDE, FRAME = (0.0, 0.0, 0.0, 0.25), (1.0, 0.55, 0.1, 0.9)  # of a film's picture


# -- the gizmo -----------------------------------------------------------------------------------


def gizmo_overlay(controls, fly) -> None:
    gizmo = None if fly.on else controls.tool.gizmo
    if gizmo is None:
        return
    lines = imgui.get_background_draw_list()
    chosen = None if controls.part is None else controls.part.name
    for part in controls.gizmo_parts():
        points = [tuple(point) for point in part.line / controls.ratio]
        color = VIEW if part.axis is None else AXES[part.axis]
        color = CHOSEN if part.name == chosen else color
        if part.across:
            lines.add_convex_poly_filled(points[:-1], LINE((*color[:3], FAINT)))
            lines.add_polyline(points, LINE(color), thickness=1.0, flags=0)
            continue
        for width, shade in ((EDGE_WIDTH, EDGE), (WIDTH, color)):
            lines.add_polyline(points, LINE(shade), thickness=width, flags=0)
        if len(points) == 3:
            _tip(lines, points, LINE(color), gizmo.kind)


def _tip(lines, points, color, kind):
    """The end of an arrow: a box if it scales."""
    (x0, y0), (x, y) = points[1:]
    if kind == "scale":
        lines.add_rect_filled((x - TIP, y - TIP), (x + TIP, y + TIP), color)
        return
    length = max(((x - x0) ** 2 + (y - y0) ** 2) ** 0.5, 1e-6)
    u, v = (x - x0) / length, (y - y0) / length
    back = x - 2.0 * TIP * u, y - 2.0 * TIP * v  # the head ends where the mouse can take it
    left, right = ((back[0] + side * TIP * v, back[1] - side * TIP * u) for side in (1.0, -1.0))
    lines.add_triangle_filled(left, right, (x, y), color)


# -- what the mouse does -------------------------------------------------------------------------


def gesture_overlay(controls, gui, grab_radius, size) -> None:
    """Draw what the gesture in progress needs."""
    lines = imgui.get_background_draw_list()
    if controls.mode == "box":
        (x0, y0), (x1, y1) = (pixel / controls.ratio for pixel in controls.holder.region)
        lines.add_rect_filled((x0, y0), (x1, y1), LINE(FILL))
        lines.add_rect((x0, y0), (x1, y1), LINE(OUTLINE))
    elif controls.mode == "lasso":
        points = [tuple(pixel / controls.ratio) for pixel in controls.holder.region]
        for start, end in zip(points, [*points[1:], points[0]], strict=True):
            lines.add_line(start, end, LINE(OUTLINE), 1.5)
    elif controls.held_drag is not None:
        _drag(controls, size, lines)
    elif not controls.mode and controls.tools["grab"].spot is not None and not gui.mouse_on_panel:
        _reach(controls, grab_radius, lines)


def _reach(controls, grab_radius, lines):
    """What a drag from under the mouse would take along, faintly."""
    camera, place = controls.camera, controls.tools["grab"].spot
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
    places = controls.holder.drag_place + np.linspace(-1.0, 1.0, 33)[:, None] * along
    pixels, _ = project(controls.camera, places)
    points = pixels[np.isfinite(pixels).all(axis=1)] / controls.ratio
    for start, end in pairwise(points):
        lines.add_line(tuple(start), tuple(end), LINE(AXES[axis]), 1.5)


def brush_overlay(settings, controls, gui) -> None:
    in_view = not gui.mouse_on_panel
    gui.point_with_cross(in_view and controls.tool.cross)
    if settings.tool != BRUSH or not in_view:
        return
    at, radius = tuple(controls.pointer / controls.ratio), settings.brush_radius
    lines = imgui.get_background_draw_list()
    lines.add_circle(at, radius + 1.0, LINE(RING_SHADE), 48, 1.5)
    lines.add_circle(at, radius, LINE(RING), 48, 1.5)


# -- boxes ---------------------------------------------------------------------------------------


def box_edges(box):
    """Points along the edges of a box [2, 3].  [12, PIECES + 1, 3]"""
    corners = np.array(list(product(*np.transpose(box))))
    shares = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
    return np.array([(1.0 - shares) * corners[a] + shares * corners[b] for a, b in EDGES])


def box_overlay(field, settings, controls, radiance) -> None:
    """Draw the box that was found around the object; what that hides is faint."""
    box = found_box(field) if settings.show_box else None
    if box is None:
        return
    depth, camera = radiance.depth_image(), controls.camera
    pixels, away = project(camera, box_edges(box).reshape(-1, 3))
    surface = np.inf
    if depth is not None:
        surface = depth_at(depth, camera, np.nan_to_num(pixels, nan=-1.0))
    colors = np.where(away <= surface, LINE(SEEN), LINE(HIDDEN)).reshape(len(EDGES), -1)
    places = pixels.reshape(len(EDGES), -1, 2) / controls.ratio
    lines = imgui.get_background_draw_list()
    for edge, shades in zip(places, colors.tolist(), strict=True):
        for (start, end), shade in zip(pairwise(edge), shades, strict=False):
            if np.isfinite([start, end]).all():
                lines.add_line(tuple(start), tuple(end), shade, 1.0)


def frame_overlay(frame) -> None:
    """Draw what a film shows of the view, and shade the rest.

    Args:
        frame: Left, top, width and height [points]: film_frame.
    """
    left, top, width, height = frame
    right, bottom, size = left + width, top + height, imgui.get_io().display_size
    lines = imgui.get_background_draw_list()
    for low, high in (
        ((0.0, 0.0), (size.x, top)),
        ((0.0, bottom), (size.x, size.y)),
        ((0.0, top), (left, bottom)),
        ((right, top), (size.x, bottom)),
    ):
        if low[0] < high[0] and low[1] < high[1]:
            lines.add_rect_filled(low, high, LINE(OUTSIDE))
    lines.add_rect((left, top), (right, bottom), LINE(FRAME))
