"""Draws a photograph over the render, or beside it, as the same pinhole shows it."""

import moderngl
import numpy as np

from ..camera import Photograph, Places
from . import gl


class PhotoLayer:
    """The photograph of one window; nothing until there is one."""

    def __init__(self, ctx: moderngl.Context):
        self._ctx = ctx
        self._triangle = gl.full_screen(ctx, "photo")
        self._texture = self._photograph = None

    def draw(self, photograph: Photograph, camera, places: Places, settings) -> None:
        if photograph is not self._photograph:
            self._upload(photograph)
        lens, size = photograph.lens, np.array([photograph.lens.width, photograph.lens.height])
        self._texture.use(0)
        gl.set_uniforms(
            self._triangle.program,
            photo=0,
            window=(camera.width, camera.height),
            axis=places.axis,
            scale=np.array(lens.focal) / camera.focal / size,
            center=np.array(lens.center) / size,
            left=places.left,
            background=settings.background,
            opacity=settings.photo_opacity if settings.photograph == "over" else 1.0,
        )
        gl.blend_over(self._ctx)
        self._triangle.render(moderngl.TRIANGLES)

    def _upload(self, photograph):
        self.release()
        rgb, alpha = np.split(photograph.pixels.astype(np.uint16), [3], axis=2)
        # Multiplied by alpha, colors of transparent pixels don't run into their neighbors.
        pixels = np.concatenate([(rgb * alpha + 127) // 255, alpha], axis=2).astype(np.uint8)
        self._texture = self._ctx.texture(pixels.shape[1::-1], 4, pixels)
        self._texture.build_mipmaps()
        self._texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        self._photograph = photograph

    def release(self) -> None:
        if self._texture is not None:
            self._texture.release()
        self._texture = self._photograph = None
