"""Draws marks on the object in two colors: what is the object's, and what would be cut off.

A mark is a small sphere at a sub-tet's middle.  It hides behind the picture's depth, like the
spheres of handles, and is drawn by their shader.

Shapes: n marks.
"""

import moderngl
import numpy as np

from . import gl
from .handle_layer import SPHERE_FLOATS

OURS, OTHERS = (0.10, 0.55, 0.95), (0.95, 0.45, 0.10)  # blue and orange: told apart by all eyes
OPACITY = 0.6
NEARER = 2.5  # radii, that a mark is drawn nearer than it is


class MarkLayer:
    """Marks on one object."""

    def __init__(self, ctx: moderngl.Context):
        self._ctx = ctx
        self._program = gl.program(ctx, "handles")
        self._buffer = self._marks = None
        self._reserved = 0

    def draw(self, camera, clip_range, marks) -> None:
        """Draw places [n, 3], of which some [n] bool are the object's, with one radius; or None."""
        if marks is None or not len(marks[0]):
            return
        places, ours, radius = marks
        instances = mark_instances(places, ours, radius, camera.position)
        self._reserve(len(instances))
        self._buffer.write(instances)
        self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        gl.blend_over(self._ctx)
        gl.set_uniforms(
            self._program,
            depth_terms=gl.depth_terms(*clip_range, camera.parallel),
            bias=NEARER * radius,
            pixel_angle=1.0 / camera.focal,
            opacity=OPACITY,
            parallel=camera.parallel,
            **gl.view_matrices(camera, clip_range),
        )
        self._marks.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(instances))

    def release(self) -> None:
        if self._buffer is not None:
            self._marks.release()
            self._buffer.release()
            self._buffer = None

    def _reserve(self, count):
        """Make space for so many."""
        if self._buffer is not None and count <= self._reserved:
            return
        self.release()
        self._reserved = count
        self._buffer = self._ctx.buffer(reserve=4 * SPHERE_FLOATS * count, dynamic=True)
        layout = (self._buffer, "3f 1f 3f/i", "center", "radius", "tint")
        self._marks = self._ctx.vertex_array(self._program, [layout])


def mark_instances(places, ours, radius: float, eye) -> np.ndarray:
    """Center, radius and tint of each mark, far ones first.  [n, 7] float32

    Args:
        places: [n, 3]
        ours: Which are the object's.  [n] bool
        eye: Where the camera is.  [3]
    """
    instances = np.empty((len(places), SPHERE_FLOATS), np.float32)
    instances[:, :3], instances[:, 3] = places, radius
    instances[:, 4:] = np.where(np.asarray(ours)[:, None], OURS, OTHERS)
    return instances[np.argsort(-np.linalg.norm(places - eye, axis=1))]
