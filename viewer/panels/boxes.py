"""Lines over the view: the box that training found, and the ring of the brush that deletes.

Of the box, what the object hides is drawn faintly.
"""

from itertools import pairwise, product

import numpy as np
from imgui_bundle import imgui

from ..camera import depth_at, project
from ..tools import BRUSH, found_box

LINE = imgui.get_color_u32
SEEN, HIDDEN = (0.10, 0.45, 0.85, 0.95), (0.10, 0.45, 0.85, 0.30)
RING, RING_SHADE = (0.90, 0.12, 0.10, 0.95), (1.0, 1.0, 1.0, 0.6)
PIECES = 24  # of an edge, each in sight or not
EDGES = [  # pairs of corners, as product(range(2), repeat=3) counts them
    (i, i + step) for step in (4, 2, 1) for i in range(8) if not i & step
]


def box_edges(box):
    """Points along the edges of a box [2, 3].  [12, PIECES + 1, 3]"""
    corners = np.array(list(product(*np.transpose(box))))
    shares = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
    return np.array([(1.0 - shares) * corners[a] + shares * corners[b] for a, b in EDGES])


def box_overlay(field, settings, controls, radiance) -> None:
    """Draw the box that was found around the object, if it is to be shown."""
    box = found_box(field)
    if box is None or not settings.show_box:
        return
    depth = radiance.depth_image()
    camera, lines = controls.camera, imgui.get_background_draw_list()
    for points in box_edges(box):
        pixels, away = project(camera, points)
        surface = np.full(len(points), np.inf)
        if depth is not None:
            surface = depth_at(depth, camera, np.nan_to_num(pixels, nan=-1.0))
        seen = away <= surface
        places = pixels / controls.ratio
        for (start, end), is_seen in zip(pairwise(places), seen, strict=False):
            if np.isfinite([start, end]).all():
                lines.add_line(tuple(start), tuple(end), LINE(SEEN if is_seen else HIDDEN), 1.0)


def brush_overlay(settings, controls, gui) -> None:
    """Draw the ring of the brush around the mouse."""
    in_view = not gui.mouse_on_panel
    gui.point_with_cross(in_view and controls.tool.cross)
    if settings.tool != BRUSH or not in_view:
        return
    at, radius = tuple(controls.pointer / controls.ratio), settings.brush_radius
    lines = imgui.get_background_draw_list()
    lines.add_circle(at, radius + 1.0, LINE(RING_SHADE), 48, 1.5)
    lines.add_circle(at, radius, LINE(RING), 48, 1.5)
