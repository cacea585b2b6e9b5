"""OpenGL helpers: programs from the shaders folder, the full-screen triangle, the canvas."""

from contextlib import contextmanager
from functools import lru_cache

import moderngl
import numpy as np

from ...core.base.paths import SHADERS
from ...core.render import Camera, view_projection

SAMPLER_BUFFER = 0x8DC2  # uniforms of this type are passed over by moderngl, without an error


def program(
    ctx: moderngl.Context, name: str, vertex: str = "", defines: tuple[str, ...] = ()
) -> moderngl.Program:
    """The program of shaders/<vertex or name>.vert.glsl and shaders/<name>.frag.glsl.

    Args:
        defines: Names that the fragment shader finds defined.
    """
    version, rest = (SHADERS / f"{name}.frag.glsl").read_text().split("\n", 1)
    return ctx.program(
        vertex_shader=(SHADERS / f"{vertex or name}.vert.glsl").read_text(),
        fragment_shader="\n".join([version, *(f"#define {one}" for one in defines), rest]),
    )


def full_screen(
    ctx: moderngl.Context, name: str, defines: tuple[str, ...] = ()
) -> moderngl.VertexArray:
    """A triangle over the whole image, drawn with shaders/<name>.frag.glsl."""
    vertex_array = ctx.vertex_array(program(ctx, name, "full_screen", defines), [])
    vertex_array.vertices = 3
    return vertex_array


def set_uniforms(program: moderngl.Program, **values) -> None:
    """Set uniforms, except those that the compiler removed; matrices are [rows, columns].

    Most stay the same from frame to frame: what a program has already is not set again.  Values
    are numbers, tuples or arrays, not lists, which a caller may change.
    """
    kept = program.extra = program.extra or {}
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            value = tuple(value.T.ravel().tolist())  # OpenGL stores columns
        if name not in kept or kept[name] != value:
            uniform = program.get(name, None)
            if uniform is not None and uniform.gl_type == SAMPLER_BUFFER:
                from pyglet import gl

                gl.glUseProgram(program.glo)
                gl.glUniform1i(uniform.location, value)
            elif uniform is not None:
                uniform.value = value
            kept[name] = value


class BufferTexture:
    """A buffer as a texture of RGBA8 or R32F texels, which moderngl has not."""

    def __init__(self, buffer: moderngl.Buffer, kind: str):
        from pyglet import gl  # not at the top: it needs a display, or headless mode

        self._gl, self._number = gl, gl.GLuint()
        gl.glGenTextures(1, self._number)
        self.use(0)
        gl.glTexBuffer(gl.GL_TEXTURE_BUFFER, getattr(gl, f"GL_{kind}"), buffer.glo)

    def use(self, unit: int) -> None:
        self._gl.glActiveTexture(self._gl.GL_TEXTURE0 + unit)
        self._gl.glBindTexture(self._gl.GL_TEXTURE_BUFFER, self._number)

    def release(self) -> None:
        self._gl.glDeleteTextures(1, self._number)


def view_matrices(camera, clip_range) -> dict:
    """The uniforms `world_to_camera` and `projection` of what is drawn by vertices."""
    pose = np.asarray(camera.camera_to_world, float).tobytes()
    return _view_matrices(pose, camera.lens, camera.parallel, clip_range)


@lru_cache(maxsize=1)  # layers draw for the same camera, which often rests
def _view_matrices(pose, lens, parallel, clip_range):
    camera = Camera(np.frombuffer(pose).reshape(4, 4), lens, parallel)
    return {
        "world_to_camera": np.linalg.inv(camera.camera_to_world),
        "projection": view_projection(camera, *clip_range) @ camera.camera_to_world,
    }


def depth_terms(near: float, far: float, parallel: bool = False) -> tuple[float, float]:
    """(a, b) with window depth = a + b / z for a distance z in front of the camera plane.

    Where rays are parallel, window depth = a + b · z.
    """
    if parallel:
        return -near / (far - near), 1.0 / (far - near)
    return far / (far - near), -far * near / (far - near)


@contextmanager
def depth_only(ctx: moderngl.Context):
    """What is drawn inside changes the depth of the framebuffer in use, not its colors."""
    framebuffer = ctx.fbo
    framebuffer.color_mask = False, False, False, False
    framebuffer.use()  # or OpenGL does not learn of the mask
    try:
        yield
    finally:
        framebuffer.color_mask = True, True, True, True
        framebuffer.use()


def blend_over(ctx: moderngl.Context, also: int = moderngl.NOTHING) -> None:
    """Blend colors over those that are there, of transparent pictures opacities; enable `also`."""
    ctx.enable_only(moderngl.BLEND | also)
    over = moderngl.ONE_MINUS_SRC_ALPHA
    ctx.blend_func = moderngl.SRC_ALPHA, over, moderngl.ONE, over


class Instances:
    """Many of one shape, each drawn from a row of floats."""

    def __init__(self, ctx: moderngl.Context, name: str, row, floats: int, most: int):
        """Take the shaders' name, moderngl's format and names of a row, and its length."""
        self._buffer = ctx.buffer(reserve=4 * floats * most, dynamic=True)
        self._array = ctx.vertex_array(program(ctx, name), [(self._buffer, *row)])
        self._count = 0

    def write(self, rows: np.ndarray) -> None:
        """Draw these from now on.  [N, floats] float32"""
        self._count = len(rows)
        if len(rows):
            self._buffer.write(rows)

    def render(self, mode: int, vertices: int, **uniforms) -> None:
        """Draw each with so many vertices."""
        if self._count:
            set_uniforms(self._array.program, **uniforms)
            self._array.render(mode, vertices, instances=self._count)

    def release(self) -> None:
        self._array.release()
        self._buffer.release()


class Canvas:
    """The framebuffer that everything is drawn into: shown in the window, read for files."""

    def __init__(self, ctx: moderngl.Context):
        self._ctx = ctx
        self._framebuffer = None
        self._blit = full_screen(ctx, "blit")

    @property
    def size(self) -> tuple[int, int]:
        return self._framebuffer.size

    def use(self, size: tuple[int, int]) -> None:
        """Draw into it from now on, with that many pixels."""
        old = self._framebuffer
        if old is None or old.size != size:
            color = self._ctx.texture(size, 4)
            color.filter = moderngl.NEAREST, moderngl.NEAREST
            depth = self._ctx.depth_renderbuffer(size)
            self._framebuffer = self._ctx.framebuffer([color], depth)
            if old is not None:
                for one in (*old.color_attachments, old.depth_attachment, old):
                    one.release()
        self._framebuffer.use()

    def read(self, channels: int = 3):
        """The drawn image, top row first; its opacity is the fourth channel.  [H, W, C] uint8"""
        width, height = self.size
        image = np.empty((height, width, channels), np.uint8)
        self._framebuffer.read_into(image, components=channels, alignment=1)
        return image[::-1]

    def flush(self) -> None:
        """Let OpenGL begin with what was drawn, without waiting for it."""
        from pyglet import gl

        gl.glFlush()

    def show(self) -> None:
        """Copy it to the window, whose framebuffer has the same size."""
        self._ctx.screen.use()
        # moderngl remembers the size of the first window.
        self._ctx.viewport = 0, 0, *self._framebuffer.size
        self._ctx.enable_only(moderngl.NOTHING)
        self._framebuffer.color_attachments[0].use(0)
        self._blit.program["image"].value = 0
        self._blit.render(moderngl.TRIANGLES)
