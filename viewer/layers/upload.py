"""Copies the renderer's arrays to OpenGL, without the host where possible.

On CUDA the arrays go into a buffer that CUDA and OpenGL share, and the shader reads it.  On
laptops and remote desktops OpenGL often runs on another GPU and they can't share: a probe at the
start finds out.  There, and on the CPU, the bytes go through host memory into textures.
"""

import logging

import moderngl
import numpy as np
import warp as wp

from . import gl

log = logging.getLogger(__name__)
PROBE_SIZE = 16


def choose_path(ctx: moderngl.Context, device: str, wanted: str) -> str:
    """The transfer of frames to OpenGL: "buffer" if CUDA and OpenGL share memory, else "copy".

    Args:
        wanted: "buffer", "copy", or "auto" for the better one.

    Raises:
        ValueError: `wanted` is "buffer", and that does not work.
    """
    if wanted == "copy" or (wanted == "auto" and not wp.get_device(device).is_cuda):
        return "copy"
    try:
        _probe(ctx, device)
    except Exception as error:  # whatever the driver raises, copying still works
        if wanted == "buffer":
            raise ValueError(f"CUDA and OpenGL share no buffers here ({error})") from error
        log.warning("CUDA and OpenGL share no buffers (%s): frames go through the host", error)
        return "copy"
    return "buffer"


def _probe(ctx, device):
    """Send a small image through shared memory; raise if it does not arrive."""
    color = np.arange(4 * PROBE_SIZE * PROBE_SIZE, dtype=np.uint8).reshape(PROBE_SIZE, -1, 4)
    depth = np.arange(PROBE_SIZE * PROBE_SIZE, dtype=np.float32).reshape(PROBE_SIZE, -1)
    shared = SharedImage(ctx, (PROBE_SIZE, PROBE_SIZE), device)
    try:
        sent = wp.array(color, dtype=wp.vec4ub, device=device), wp.array(depth, device=device)
        shared._write(sent, 0)
        if shared.read() != color.tobytes() + depth.tobytes():
            raise RuntimeError("what was written is not what was read")
    finally:
        shared.release()


def image_target(ctx: moderngl.Context, size: tuple[int, int], device: str, path: str):
    """Where OpenGL reads an image from, which comes there by the path of `choose_path`."""
    return SharedImage(ctx, size, device) if path == "buffer" else ImageTexture(ctx, size)


class ImageTarget:
    """A color and a depth image of one size that shaders read, filled by strips of rows."""

    def prepare(self) -> None:
        """Begin to make it ready for the next `write`; does not wait."""

    def write_color(self, color, first_row: int = 0) -> None:
        """Put colors [h, w] vec4ub at `first_row`, counted from the top."""
        self._write([color], first_row)

    def write(self, image, first_row: int = 0) -> None:
        """Put an Image of core/render at `first_row`, counted from the top."""
        self._write([image.color, image.depth], first_row)


class SharedImage(ImageTarget):
    """Both images in an OpenGL buffer that CUDA writes.

    Textures would be a copy more: of 1920x1080, some 0.5 ms.  Before CUDA may write, the GPU waits
    0.3 ms for OpenGL: `prepare` has it wait while an image is rendered.
    """

    is_buffer = True

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], device: str):
        self.size, self._device = size, device
        self._byte_count = 4 * size[0] * size[1]  # of the colors; the depths follow
        self._buffer = ctx.buffer(reserve=2 * self._byte_count, dynamic=True)
        self._shared, self._views = None, []
        self._mapped = self._beside = None
        try:
            self._register()
            self._views = [gl.BufferTexture(self._buffer, kind) for kind in ("RGBA8", "R32F")]
        except BaseException:
            self.release()
            raise

    def _register(self):
        if not wp.get_device(self._device).is_cuda:
            raise RuntimeError("the renderer runs on the CPU")
        # Strips are written one by one: what is there stays.
        number, kind = self._buffer.glo, wp.RegisteredGLBuffer
        self._shared = kind(number, self._device, kind.NONE, fallback_to_copy=False)
        self._beside = wp.Stream(self._device)

    def prepare(self) -> None:
        """Begin to take the buffer from OpenGL, for the next `write`; does not wait."""
        if self._beside is not None and self._mapped is None:
            # What is launched later does not wait for this stream, only `write` does.
            with wp.ScopedStream(self._beside, sync_enter=False):
                self._map()

    def _map(self):
        self._mapped = self._shared.map(dtype=wp.uint8, shape=(2 * self._byte_count,))

    def _unmap(self):
        if self._mapped is not None:
            wp.get_stream(self._device).wait_stream(self._beside)
            self._shared.unmap()
            self._mapped = None

    def _write(self, arrays, first_row):
        height, width = arrays[0].shape
        assert width == self.size[0] and first_row + height <= self.size[1], arrays[0].shape
        if self._mapped is None:
            self._map()
        wp.get_stream(self._device).wait_stream(self._beside)
        for index, array in enumerate(arrays):
            start = self._mapped.ptr + index * self._byte_count + 4 * first_row * self.size[0]
            target = wp.array(ptr=start, dtype=array.dtype, shape=array.shape, device=array.device)
            wp.copy(target, array)
        self._unmap()

    def use(self) -> None:
        """Give shaders that find BUFFER defined the colors as unit 0 and the depths as unit 1.

        They find both in each of them, one after the other, and only one in the right format.
        """
        self._unmap()  # if no image came
        for unit, view in enumerate(self._views):
            view.use(unit)

    def read(self) -> bytes:
        """All colors, then all depths."""
        self._unmap()
        return self._buffer.read()

    def release(self) -> None:
        self._unmap()
        self._shared = None  # unregistered before OpenGL deletes the buffer
        for view in self._views:
            view.release()
        self._views = []
        self._buffer.release()


class ImageTexture(ImageTarget):
    """A texture of each, which the host fills."""

    is_buffer = False

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]):
        self.size = size
        self.color = ctx.texture(size, 4, dtype="f1")
        self.color.filter = moderngl.LINEAR, moderngl.LINEAR
        self.depth = ctx.texture(size, 1, dtype="f4")
        self.depth.filter = moderngl.NEAREST, moderngl.NEAREST  # inf must not be blended
        for texture in (self.color, self.depth):
            texture.repeat_x = texture.repeat_y = False
        self._pinned = {}  # memory of the host that CUDA copies to, by the pixels' type

    def _write(self, arrays, first_row):
        for texture, pixels in zip((self.color, self.depth), arrays, strict=False):
            if pixels.device.is_cuda:
                pixels = self._pinned_copy(pixels)
            height, width = pixels.shape
            strip = 0, first_row, width, height
            texture.write(np.ascontiguousarray(pixels.numpy()), viewport=strip)

    def _pinned_copy(self, pixels):
        """On the host; the next call may overwrite it."""
        if pixels.dtype not in self._pinned:
            count = self.size[0] * self.size[1]
            memory = wp.empty(count, dtype=pixels.dtype, device="cpu", pinned=True)
            self._pinned[pixels.dtype] = memory
        pinned = self._pinned[pixels.dtype][: pixels.size].reshape(pixels.shape)
        wp.copy(pinned, pixels.contiguous())
        wp.synchronize_device(pixels.device)
        return pinned

    def use(self) -> None:
        """Give shaders the colors as unit 0 and the depths as unit 1."""
        self.color.use(0)
        self.depth.use(1)

    def release(self) -> None:
        self.color.release()
        self.depth.release()
