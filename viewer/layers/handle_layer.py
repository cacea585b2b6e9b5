"""Draws the red spheres of the control vertices and the gray ones of the pins.

They are drawn after the radiance layer and hide behind its depth.  Spheres are drawn nearer
than they are by the object's handle_bias; picking.visible uses the same bias.
"""

from typing import Protocol

import moderngl
import numpy as np

from ...core.field import TetField
from ..document import MOST_ADDED, MOST_POINTS, Ball, Grab
from ..settings import Settings
from . import gl

RED, ORANGE, YELLOW = (0.95, 0.10, 0.08), (1.0, 0.45, 0.05), (1.0, 0.85, 0.1)
SELECTED = (1.0, 0.62, 0.0)
VIOLET = (0.55, 0.20, 0.80)  # posed
STIFF_BLUE, SOFT_PINK = (0.10, 0.12, 0.50), (1.0, 0.75, 0.72)
BALL_GRAY = (0.72, 0.72, 0.75)
PIN_BLUE = (0.42, 0.50, 0.62)
HOVER_SCALE, PIN_SCALE = 1.35, 0.6
GHOST = 0.35  # opacity of what the object hides of a held sphere
SPHERE_FLOATS = 7  # center, radius, tint


class DrawnHandles(Protocol):
    """Handles, and what a hand does with them."""

    pin_ids: np.ndarray
    control_ids: np.ndarray
    posed: tuple[int, ...]
    selected: list[int]
    hover: int | None
    grabbed: Grab | None

    def at(self, ids) -> np.ndarray: ...
    def factors(self, ids) -> np.ndarray: ...


class Painted(Protocol):
    """A body."""

    factors: np.ndarray | None  # of its stiffness  [V]


class WithSpheres(Protocol):
    """The object whose spheres are drawn."""

    field: TetField
    settings: Settings
    handle_radius: float
    handle_bias: float
    ball: Ball | None
    body: Painted
    handles: DrawnHandles


class HandleLayer:
    """Spheres of one object."""

    def __init__(self, ctx: moderngl.Context, drawn: WithSpheres):
        self._ctx, self._drawn = ctx, drawn
        mesh = drawn.field.mesh
        most = mesh.vertex_count + MOST_POINTS + MOST_ADDED + 1  # and the ball
        size = 4 * SPHERE_FLOATS * most
        self._sphere_buffer = ctx.buffer(reserve=size, dynamic=True)
        layout = (self._sphere_buffer, "3f 1f 3f/i", "center", "radius", "tint")
        self._spheres = ctx.vertex_array(gl.program(ctx, "handles"), [layout])

    def draw(self, camera, clip_range) -> None:
        """Draw into the framebuffer in use what the settings ask for."""
        if not self._drawn.settings.show_handles and self._drawn.ball is None:
            return
        instances = sphere_instances(self._drawn, camera.position)
        if not len(instances):
            return
        self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        gl.blend_over(self._ctx)
        self._sphere_buffer.write(instances)
        gl.set_uniforms(
            self._spheres.program,
            depth_terms=gl.depth_terms(*clip_range, camera.parallel),
            bias=self._drawn.handle_bias,
            pixel_angle=1.0 / camera.focal,
            opacity=1.0,
            parallel=camera.parallel,
            **gl.view_matrices(camera, clip_range),
        )
        self._spheres.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(instances))
        held = held_sphere(self._drawn)
        if len(held):  # what of it is inside the object, faintly
            self._sphere_buffer.write(held)
            gl.set_uniforms(self._spheres.program, opacity=GHOST)
            self._ctx.depth_func = ">"
            self._spheres.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(held))
            self._ctx.depth_func = "<="

    def release(self) -> None:
        self._spheres.release()
        self._sphere_buffer.release()


def sphere_instances(drawn: WithSpheres, eye):
    """Center, radius and tint of every sphere, those far from the eye [3] first.  [S, 7] float32

    The soft edge of a sphere blends with what was drawn before it.
    """
    nobody = np.empty(0, int)
    handles, pin_ids, control_ids = drawn.handles, nobody, nobody
    if drawn.settings.show_handles:
        pin_ids, control_ids = handles.pin_ids, handles.control_ids
    ids = np.concatenate([pin_ids, control_ids])
    instances = np.empty((len(ids), SPHERE_FLOATS), np.float32)
    instances[:, :3] = handles.at(ids)
    instances[:, 3] = drawn.handle_radius
    instances[:, 4:] = RED
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
        ball = np.array([[*drawn.ball.reached, drawn.ball.radius, *BALL_GRAY]], np.float32)
        instances = np.concatenate([instances, ball])
    away = np.linalg.norm(instances[:, :3] - eye, axis=1)
    return instances[np.argsort(-away)]


def held_sphere(drawn: WithSpheres):
    """The sphere of the vertex that is held, as sphere_instances has it.  [held, 7] float32"""
    handles = drawn.handles
    if handles.grabbed is None or not drawn.settings.show_handles:
        return np.empty((0, SPHERE_FLOATS), np.float32)
    held = np.empty((len(handles.grabbed.handles), SPHERE_FLOATS), np.float32)
    held[:, :3] = handles.at(handles.grabbed.handles)
    held[:, 3], held[:, 4:] = drawn.handle_radius, YELLOW
    return held


def stiffness_tints(factors):
    """Colors of vertices whose stiffness is multiplied: dark if stiff, pale if soft.  [N, 3]"""
    share = np.clip(np.log10(factors), -1.0, 1.0)[:, None]
    to = np.where(share > 0.0, STIFF_BLUE, SOFT_PINK)
    return (1.0 - np.abs(share)) * np.array(RED) + np.abs(share) * to
