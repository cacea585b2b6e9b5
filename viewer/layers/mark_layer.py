"""Draws marks on the object, colored spheres at middles of sub-tets, that hide behind its depth.

Shapes: n marks.
"""

import moderngl
import numpy as np

from . import gl
from .handle_layer import SPHERE_FLOATS, Spheres

MOST = 12_000
OPACITY = 0.6
NEARER = 2.5  # radii, that a mark is drawn nearer than it is


class MarkLayer(Spheres):
    """Marks on one object."""

    def __init__(self, ctx: moderngl.Context):
        super().__init__(ctx, MOST)
        self._ctx = ctx

    def draw_marks(self, camera, clip_range, marks) -> None:
        """Draw places [n, 3] with tints [n, 3] and one radius, n at most MOST."""
        self.write(mark_instances(*marks, camera.position))
        self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        gl.blend_over(self._ctx)
        self.draw(camera, clip_range, NEARER * marks[-1], OPACITY)


def mark_instances(places, tints, radius: float, eye) -> np.ndarray:
    """Center, radius and tint of each mark, far ones first.  [n, 7] float32"""
    instances = np.empty((len(places), SPHERE_FLOATS), np.float32)
    instances[:, :3], instances[:, 3], instances[:, 4:] = places, radius, tints
    return instances[np.argsort(-np.linalg.norm(places - eye, axis=1))]
