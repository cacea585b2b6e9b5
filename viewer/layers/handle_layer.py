"""Draws the red spheres of control vertices, the gray ones of pins, and marks on the object.

They are drawn after the radiance layer and hide behind its depth.  Spheres are drawn nearer
than they are by the object's handle_bias; picking.visible uses the same bias.  Marks are colored
spheres at middles of sub-tets.
"""

import moderngl
import numpy as np

from ..document import MOST_ADDED, MOST_POINTS
from ..settings import shows_points
from . import gl
from .drawn import DrawnObject

RED, ORANGE, YELLOW = (0.95, 0.10, 0.08), (1.0, 0.45, 0.05), (1.0, 0.85, 0.1)
SELECTED = (1.0, 0.62, 0.0)
VIOLET = (0.55, 0.20, 0.80)  # posed
STIFF_BLUE, SOFT_PINK = (0.10, 0.12, 0.50), (1.0, 0.75, 0.72)
BALL_GRAY = (0.72, 0.72, 0.75)
PIN_BLUE = (0.42, 0.50, 0.62)
HOVER_SCALE, PIN_SCALE = 1.35, 0.6
GHOST = 0.35  # opacity of what the object hides of a held sphere
SPHERE_FLOATS = 7  # center, radius, tint
MOST_MARKS, MARK_OPACITY = 12_000, 0.6
MARK_NEARER = 2.5  # radii, that a mark is drawn nearer than it is


class Spheres(gl.Instances):
    """Spheres of a center, a radius and a tint each."""

    def __init__(self, ctx: moderngl.Context, most: int):
        row = "3f 1f 3f/i", "center", "radius", "tint"
        super().__init__(ctx, "handles", row, SPHERE_FLOATS, most)

    def draw(self, camera, clip_range, bias: float = 0.0, opacity: float = 1.0) -> None:
        """Draw into the framebuffer in use, nearer by the bias than they are [model units]."""
        self.render(
            moderngl.TRIANGLE_STRIP,
            vertices=4,
            depth_terms=gl.depth_terms(*clip_range, camera.parallel),
            bias=bias,
            pixel_angle=1.0 / camera.focal,
            opacity=opacity,
            parallel=camera.parallel,
            **gl.view_matrices(camera, clip_range),
        )


def sphere_rows(places, radius, tint):
    """Spheres as `Spheres.write` takes them.  [S, 7] float32

    Args:
        places: Their centers.  [S, 3]
        radius, tint: Of all, or of each: [S], [S, 3].
    """
    rows = np.empty((len(places), SPHERE_FLOATS), np.float32)
    rows[:, :3], rows[:, 3], rows[:, 4:] = places, radius, tint
    return rows


def far_first(rows, places, eye):
    """The rows of what is at places [S, 3], those far from the eye [3] first."""
    return rows[np.argsort(-np.linalg.norm(places - eye, axis=1), kind="stable")]


class MarkLayer(Spheres):
    """Marks on one object."""

    def __init__(self, ctx: moderngl.Context):
        super().__init__(ctx, MOST_MARKS)
        self._ctx = ctx

    def draw_marks(self, camera, clip_range, marks) -> None:
        """Draw places [n, 3] with tints [n, 3] and one radius, n at most MOST_MARKS."""
        places, tints, radius = marks
        self.write(far_first(sphere_rows(places, radius, tints), places, camera.position))
        gl.blend_over(self._ctx, moderngl.DEPTH_TEST)
        self.draw(camera, clip_range, MARK_NEARER * radius, MARK_OPACITY)


class HandleLayer:
    """Spheres of one object."""

    def __init__(self, ctx: moderngl.Context, drawn: DrawnObject):
        self._ctx, self._drawn = ctx, drawn
        most = drawn.field.mesh.vertex_count + MOST_POINTS + MOST_ADDED + 1  # and the ball
        self._spheres = Spheres(ctx, most)

    def draw(self, camera, clip_range) -> None:
        """Draw into the framebuffer in use what the settings ask for."""
        drawn, spheres = self._drawn, self._spheres
        if not shows_points(drawn.settings) and drawn.ball is None:
            return
        gl.blend_over(self._ctx, moderngl.DEPTH_TEST)
        spheres.write(sphere_instances(drawn, camera.position))
        spheres.draw(camera, clip_range, drawn.handle_bias)
        grabbed = drawn.handles.grabbed
        if grabbed is not None and shows_points(drawn.settings):
            held = drawn.handles.at(grabbed.handles)
            spheres.write(sphere_rows(held, drawn.handle_radius, YELLOW))
            self._ctx.depth_func = ">"  # what of it is inside the object, faintly
            spheres.draw(camera, clip_range, drawn.handle_bias, GHOST)
            self._ctx.depth_func = "<="

    def release(self) -> None:
        self._spheres.release()


def sphere_instances(drawn: DrawnObject, eye):
    """Rows of all spheres, those far from the eye [3] first.  [S, 7] float32

    The soft edge of a sphere blends with what was drawn before it.
    """
    handles, pin_ids, control_ids = drawn.handles, np.empty(0, int), np.empty(0, int)
    if shows_points(drawn.settings):
        pin_ids, control_ids = handles.pin_ids, handles.control_ids
    ids = np.concatenate([pin_ids, control_ids])
    instances = sphere_rows(handles.at(ids), drawn.handle_radius, RED)
    instances[: len(pin_ids), 3] *= PIN_SCALE
    instances[: len(pin_ids), 4:] = PIN_BLUE
    if drawn.body.factors is not None:
        instances[len(pin_ids) :, 4:] = stiffness_tints(handles.factors(control_ids))
    instances[np.isin(ids, handles.posed), 4:] = VIOLET
    instances[np.isin(ids, handles.selected), 4:] = SELECTED
    if handles.hover is not None:
        instances[ids == handles.hover, 3] = HOVER_SCALE * drawn.handle_radius
        instances[ids == handles.hover, 4:] = ORANGE
    if handles.grabbed is not None:
        instances[np.isin(ids, handles.grabbed.handles), 4:] = YELLOW
    if drawn.ball is not None:
        ball = sphere_rows([drawn.ball.reached], drawn.ball.radius, BALL_GRAY)
        instances = np.concatenate([instances, ball])
    return far_first(instances, instances[:, :3], eye)


def stiffness_tints(factors):
    """Colors of vertices whose stiffness is multiplied: dark if stiff, pale if soft.  [N, 3]"""
    share = np.clip(np.log10(factors), -1.0, 1.0)[:, None]
    to = np.where(share > 0.0, STIFF_BLUE, SOFT_PINK)
    return (1.0 - np.abs(share)) * np.array(RED) + np.abs(share) * to
