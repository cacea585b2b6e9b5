"""The image that temporal upsampling makes of coarse pictures (core/render/temporal.py), in OpenGL.

Two passes of shaders/upsample.frag.glsl.  The first one compares the coarse picture with the image
before at the places where its surfaces were; the second one puts the new image together, with the
colors of before corrected by these differences: light that changes is followed, and what is
wrong doesn't stay.  Where nothing has moved, pixels stay what they were.  Both passes work on the
object's part alone; the rest is background.
"""

from dataclasses import dataclass

import moderngl
import numpy as np

from . import gl
from .upload import ImageTexture

ROOM = 2  # coarse pixels around the object: its soft edges, and neighbors that are read


@dataclass(frozen=True)
class CoarsePicture:
    """A picture with a ray for every n-th pixel of an image."""

    colors: np.ndarray  # [h, w, 4] uint8
    box: tuple | None  # `object_box` of the colors
    places: np.ndarray | None  # of the box, by `places_before`.  [rows, columns, 4] float32
    stride: tuple[int, int]  # n, across and down
    phase: tuple[int, int]  # the image's pixel of the first ray: column, row
    moved: bool = True  # whether anything has moved since the image before


class UpsampledImage:
    """A color and a depth texture, like ImageTexture's, that coarse pictures are added to.

    Depths of soft edges (opacity below ½) are those of the surface beside them.
    """

    is_buffer = False

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]):
        self.size, self._ctx = size, ctx
        self._images = [_Target(ctx, size) for _ in range(2)]  # the newest one, the one before
        self._coarse = None  # textures of coarse pictures of the last size
        defines = (), ("DIFFERENCE",)
        self._second, self._first = (gl.full_screen(ctx, "upsample", one) for one in defines)

    @property
    def color(self) -> moderngl.Texture:
        """The colors, opacity as alpha."""
        return self._images[0].color

    @property
    def depth(self) -> moderngl.Texture:
        """The distances along the rays."""
        return self._images[0].depth

    def use(self) -> None:
        """Give shaders the colors as unit 0 and the depths as unit 1."""
        self.color.use(0)
        self.depth.use(1)

    def clear(self, background) -> None:
        """Forget what was before: the newest image is background alone."""
        self._images[0].clear(background)

    def add(self, coarse: "CoarsePicture", camera, background, before=None) -> None:
        """Make the next image of a coarse picture.

        Args:
            camera: Of the whole image.
            background: Color where nothing is, 0..1.
            before: The image before, an ImageTexture, if it is none of this object's own.
        """
        source, target = before or self._images[0], self._images[1]
        target.clear(background)
        if coarse.box is not None:
            self._fill(coarse, camera, source, target)
        self._images.reverse()

    def _fill(self, coarse, camera, source, target):
        ctx, (first, last, left, right) = self._ctx, coarse.box
        textures = self._textures_of(coarse.colors.shape[1::-1])
        part = left, first, right - left, last - first
        colors = coarse.colors[first:last, left:right]
        textures.color.write(np.ascontiguousarray(colors), viewport=part)
        textures.places.write(coarse.places, viewport=part)
        given = textures.color, textures.places, source.color, source.depth, textures.differences
        for unit, texture in enumerate(given):
            texture.use(unit)
        names = "coarse_color", "places", "before_color", "before_depth", "differences"
        values = {name: unit for unit, name in enumerate(names)}
        values |= {"texel": 1.0 / camera.focal, "parallel": camera.parallel}
        values |= {"stride": coarse.stride, "phase": coarse.phase}
        values["moved"] = coarse.moved
        outer = ctx.fbo
        ctx.enable_only(moderngl.NOTHING)
        for one, framebuffer, rectangle in (
            (self._first, textures.framebuffer, part),
            (self._second, target.framebuffer, self._inner(coarse)),
        ):
            framebuffer.scissor = rectangle
            framebuffer.use()
            gl.set_uniforms(one.program, **values)
            one.render(moderngl.TRIANGLES)
        outer.use()

    def _inner(self, coarse):
        """The image's pixels whose coarse neighbors are in the box: x, y, width, height."""
        first, last, left, right = coarse.box
        rectangle = []
        for axis, (low, high) in enumerate(((left, right), (first, last))):
            n, at_end = coarse.stride[axis], high == coarse.colors.shape[1 - axis]
            start = 0 if low == 0 else (low + 1) * n
            rectangle.append((start, (self.size[axis] if at_end else (high - 1) * n) - start))
        (x, width), (y, height) = rectangle
        return x, y, width, height

    def _textures_of(self, size):
        if self._coarse is None or self._coarse.color.size != size:
            if self._coarse is not None:
                self._coarse.release()
            self._coarse = _CoarseTextures(self._ctx, size)
        return self._coarse

    def release(self) -> None:
        for one in (*self._images, *([self._coarse] if self._coarse else [])):
            one.release()
        for one in (self._first, self._second):
            one.program.release()
            one.release()


def object_box(colors) -> tuple[int, int, int, int] | None:
    """The part of a picture that is more than background, with ROOM around it.

    First and last + 1 rows, then columns; None if all is background.

    Args:
        colors: [h, w, 4] uint8
    """
    opaque = colors[..., 3] > 0
    box = []
    for axis in (1, 0):
        found = np.flatnonzero(opaque.any(axis=axis))
        if not len(found):
            return None
        count = opaque.shape[1 - axis]
        box += [max(int(found[0]) - ROOM, 0), min(int(found[-1]) + 1 + ROOM, count)]
    return tuple(box)


class _Target(ImageTexture):
    """An ImageTexture that is drawn into."""

    def __init__(self, ctx, size):
        super().__init__(ctx, size)
        self.framebuffer = ctx.framebuffer([self.color, self.depth])
        self._empty = None  # a background, and the bytes of an image of it

    def clear(self, background):
        """Let it be background alone.

        Bytes are written: OpenGL's clearing depends on masks and scissors of other framebuffers.
        """
        if self._empty is None or self._empty[0] != tuple(background):
            width, height = self.size
            color = np.zeros((height, width, 4), np.uint8)
            color[..., :3] = np.round(255.0 * np.array(background))
            depth = np.full((height, width), np.inf, np.float32)
            self._empty = tuple(background), color, depth
        _, color, depth = self._empty
        self.color.write(color)
        self.depth.write(depth)

    def release(self):
        self.framebuffer.release()
        super().release()


class _CoarseTextures:
    """Textures of a coarse picture, and what the first pass finds for it."""

    def __init__(self, ctx, size):
        kinds = ("color", "f1"), ("places", "f4"), ("differences", "f2")
        for name, kind in kinds:
            texture = ctx.texture(size, 4, dtype=kind)
            texture.filter = moderngl.NEAREST, moderngl.NEAREST
            setattr(self, name, texture)
        self.framebuffer = ctx.framebuffer([self.differences])

    def release(self):
        for one in (self.framebuffer, self.color, self.places, self.differences):
            one.release()
