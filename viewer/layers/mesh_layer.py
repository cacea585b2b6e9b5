"""Draws the surface of the coarse mesh: plain, in colors of strain or volume, or its edges alone.

The radiance field lies inside that surface, so that it covers the picture, as far as it is
opaque.  Its faces hide each other by a depth of their own: spheres are drawn afterwards, and
hide behind the picture's depth alone, where they can be picked.

    strain         max |principal stretch − 1| of the tets (core/deform/strain.py)
    volume ratio   of the tets, now to at rest

both as means about each vertex, by volume, interpolated over the faces.
"""

import moderngl
import numpy as np

from ...core.deform import (
    at_vertices,
    deformation_gradients,
    rest_tets,
    strains,
    volume_ratios,
)
from ...core.geometry import boundary_faces
from . import gl
from .drawn import DrawnObject
from .legend import COLORS, ColorScale, Legend

PLAIN = np.tile([0.80, 0.78, 0.74], (17, 1))
SHADING = {"plain": (0.35, 1.1)}
LIGHT_SHADING = 0.72, 1.05  # of colors that mean something
WIRE_OPACITY = 0.9


class MeshLayer:
    """The surface of one object's mesh."""

    def __init__(self, ctx: moderngl.Context, drawn: DrawnObject, draw_depth):
        """Take a function that fills the framebuffer's depth with the picture's again."""
        self._ctx, self._drawn, self._draw_depth = ctx, drawn, draw_depth
        self._program = gl.program(ctx, "mesh")
        self._legend = Legend(ctx)
        self._kept = self._buffer = self._faces = None
        self._take_tets()

    def _take_tets(self):
        """Make space for the faces around the tets that are left."""
        cuts, ctx = self._drawn.cuts, self._ctx
        self._kept, tets = cuts.kept, cuts.tets
        faces, _ = boundary_faces(tets, cuts.neighbours)
        self._corners = faces.ravel()
        self._tets = tets[np.isin(tets, faces).any(axis=1)]  # about the seen vertices
        self.release()
        self._buffer = ctx.buffer(reserve=max(16 * len(self._corners), 16), dynamic=True)
        layout = (self._buffer, "3f 1f", "position", "share")
        self._faces = ctx.vertex_array(self._program, [layout])
        self._written = None  # what the buffer holds
        self._shape = self._rest = None  # a rest shape, and its RestTets

    def draw(self, camera, clip_range, covered: int = 0) -> None:
        """Draw into the framebuffer in use what the settings ask for.

        Args:
            covered: By panels, at the right edge [pixels]; the legend is left of it.
        """
        settings, ctx = self._drawn.settings, self._ctx
        filled = settings.mesh_surface != "hidden" and settings.mesh_opacity > 0.0
        if not filled and not settings.show_wireframe:
            return
        if self._kept is not self._drawn.cuts.kept:
            self._take_tets()
        self._write()
        scale = scale_of(settings)
        gl.set_uniforms(
            self._faces.program,
            parallel=camera.parallel,
            **gl.view_matrices(camera, clip_range),
            bias=0.5 * self._drawn.handle_radius,  # the depth image may be coarser than the window
            shading=SHADING.get(settings.mesh_surface, LIGHT_SHADING),
            opacity=settings.mesh_opacity if filled else 0.0,
            wire=WIRE_OPACITY * settings.show_wireframe,
        )
        colors = PLAIN if scale is None else COLORS[scale.colors]
        self._faces.program["colors"].value = [tuple(color) for color in colors]
        ctx.enable_only(moderngl.DEPTH_TEST)
        with gl.depth_only(ctx):  # of the nearest faces, so that these alone are blended
            self._faces.render(moderngl.TRIANGLES)
        gl.blend_over(ctx, moderngl.DEPTH_TEST)
        self._faces.render(moderngl.TRIANGLES)
        self._draw_depth()
        if filled and scale is not None:
            self._legend.draw(scale, (camera.width, camera.height), covered)

    def release(self) -> None:
        self._legend.release()
        for one in (self._faces, self._buffer):
            if one is not None:
                one.release()

    def _write(self):
        """Bring positions and shares of the scale to the buffer, if they have changed."""
        drawn = self._drawn
        scale, shape = scale_of(drawn.settings), drawn.solver.rest_shape
        if scale is not None and shape is not self._shape:
            self._shape, self._rest = shape, rest_tets(shape, self._tets)
            self._written = None
        if self._written == (drawn.revision, scale):
            return
        vertices = np.zeros((len(drawn.positions), 4), np.float32)
        vertices[:, :3] = drawn.positions
        if scale is not None:
            vertices[:, 3] = scale.share(values_of(scale.word, drawn.positions, self._rest))
        self._buffer.write(vertices[self._corners])
        self._written = drawn.revision, scale


def values_of(word: str, positions, rest):
    """Strain or volume ratio at the vertices [V, 3] of RestTets.  [V]"""
    gradients = deformation_gradients(positions, rest)
    values = strains(gradients) if word == "strain" else volume_ratios(gradients)
    return at_vertices(values, rest, len(positions))


def scale_of(settings) -> ColorScale | None:
    """The colors that the settings ask for; None without any."""
    most = settings.mesh_range
    if settings.mesh_surface == "strain":
        return ColorScale("strain", "viridis", 0.0, most)
    if settings.mesh_surface == "volume ratio":
        return ColorScale("volume ratio", "coolwarm", 1.0 - most, 1.0 + most)
    return None
