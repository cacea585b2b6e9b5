"""The gizmo over the picture, and the switch that says what it does."""

from functools import partial

from imgui_bundle import imgui

from ..settings import GIZMOS
from .selection import AXES
from .widgets import action_box, segments, text_field

LINE = imgui.get_color_u32
VIEW = (0.35, 0.36, 0.40, 0.9)  # what has no axis
CHOSEN = (1.0, 0.72, 0.05, 1.0)
EDGE = (1.0, 1.0, 1.0, 0.55)  # around the lines, so that they show on any picture
WIDTH, EDGE_WIDTH = 2.5, 4.5  # points
CHOICE = 88.0  # points, of the box of what it does
TIP = 6.0  # points, of an arrow's head, or half a box
FAINT = 0.45  # opacity of a square
HINTS = {"move": "0.1", "turn": "45", "scale": "1.5"}
UNITS = {"move": "in sizes of the object", "turn": "in degrees", "scale": "a factor"}


def gizmo_overlay(controls, fly) -> None:
    """Draw the gizmo beneath the panels."""
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


def gizmo_switch(settings, controls, gui, actions) -> None:
    """What the gizmo does, and along which axes."""
    words = {kind: kind.capitalize() for kind in GIZMOS}
    told = actions.told("next_gizmo")
    segments(words, settings.gizmo, partial(setattr, settings, "gizmo"), lambda kind: told)
    imgui.same_line()
    action_box(actions, "own_axes")
    gizmo = controls.tool.gizmo
    if gizmo is not None and imgui.tree_node("by numbers"):
        _amount(controls, gui, gizmo.kind)
        imgui.tree_pop()


def _amount(controls, gui, kind):
    """A number, and buttons that move, turn or scale by it."""
    gui.amount = text_field("##amount", gui.amount, HINTS[kind], CHOICE)
    imgui.set_item_tooltip(UNITS[kind])
    for axis, name in enumerate("xyz"):
        imgui.same_line()
        if imgui.button(f"{kind} {name}"):
            controls.apply(gui.amount, axis)
