"""Copies the renderer's arrays to OpenGL textures, without the host where possible.

On CUDA the arrays go into pixel buffers that CUDA and OpenGL share.  On laptops and remote
desktops OpenGL often runs on another GPU and they can't share: a probe at the start finds
out.  There, and on the CPU, the bytes go through host memory.
"""

import logging

import moderngl
import numpy as np
import warp as wp

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
    """Send a small image through a shared buffer; raise if it does not arrive."""
    sent = np.arange(PROBE_SIZE * PROBE_SIZE * 4, dtype=np.uint8).reshape(PROBE_SIZE, -1, 4)
    texture = ctx.texture((PROBE_SIZE, PROBE_SIZE), 4)
    buffer = SharedBuffer(ctx, device, wp.vec4ub, sent.nbytes)
    try:
        buffer.write(texture, wp.array(sent, dtype=wp.vec4ub, device=device), None)
        if not np.array_equal(np.frombuffer(texture.read(), np.uint8), sent.ravel()):
            raise RuntimeError("what was written is not what was read")
    finally:
        buffer.release()
        texture.release()


class SharedBuffer:
    """An OpenGL pixel buffer that CUDA writes and a texture reads."""

    def __init__(self, ctx: moderngl.Context, device: str, dtype, byte_count: int):
        if not wp.get_device(device).is_cuda:
            raise RuntimeError("the renderer runs on the CPU")
        self._dtype = dtype
        self._buffer = ctx.buffer(reserve=byte_count, dynamic=True)
        self._shared = wp.RegisteredGLBuffer(
            self._buffer.glo,
            device,
            flags=wp.RegisteredGLBuffer.WRITE_DISCARD,
            fallback_to_copy=False,
        )

    def write(self, texture: moderngl.Texture, image, viewport) -> None:
        mapped = self._shared.map(dtype=self._dtype, shape=(image.size,))
        wp.copy(mapped, image.flatten())
        self._shared.unmap()
        texture.write(self._buffer, viewport=viewport)

    def release(self) -> None:
        self._shared = None  # unregistered before OpenGL deletes the buffer
        self._buffer.release()


class ImageTexture:
    """A color and a depth texture of one size, filled by strips of rows."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], device: str, path: str):
        self.size = size
        self.color = ctx.texture(size, 4, dtype="f1")
        self.color.filter = moderngl.LINEAR, moderngl.LINEAR
        self.depth = ctx.texture(size, 1, dtype="f4")
        self.depth.filter = moderngl.NEAREST, moderngl.NEAREST  # inf must not be blended
        for texture in (self.color, self.depth):
            texture.repeat_x = texture.repeat_y = False
        self._color_buffer = self._depth_buffer = None  # without them, the host copies
        self._pinned = {}  # memory of the host that CUDA copies to, by the pixels' type
        if path == "buffer":
            byte_count = 4 * size[0] * size[1]
            self._color_buffer = SharedBuffer(ctx, device, wp.vec4ub, byte_count)
            self._depth_buffer = SharedBuffer(ctx, device, wp.float32, byte_count)

    def write_color(self, color, first_row: int = 0) -> None:
        """Put colors [h, w] vec4ub at `first_row`, counted from the top."""
        self._write(self.color, self._color_buffer, color, first_row)

    def write(self, image, first_row: int = 0) -> None:
        """Put an Image of core/render at `first_row`, counted from the top."""
        self.write_color(image.color, first_row)
        self._write(self.depth, self._depth_buffer, image.depth, first_row)

    def _write(self, texture, buffer, pixels, first_row):
        height, width = pixels.shape
        assert width == self.size[0] and first_row + height <= self.size[1], pixels.shape
        viewport = 0, first_row, width, height
        if buffer is None:
            texture.write(self._on_host(pixels), viewport=viewport)
        else:
            buffer.write(texture, pixels, viewport)

    def _on_host(self, pixels):
        """The pixels as a NumPy array, which the next call may overwrite."""
        if not pixels.device.is_cuda:
            return np.ascontiguousarray(pixels.numpy())
        if pixels.dtype not in self._pinned:
            count = self.size[0] * self.size[1]
            room = wp.empty(count, dtype=pixels.dtype, device="cpu", pinned=True)
            self._pinned[pixels.dtype] = room
        pinned = self._pinned[pixels.dtype][: pixels.size].reshape(pixels.shape)
        wp.copy(pinned, pixels.contiguous())
        wp.synchronize_device(pixels.device)
        return pinned.numpy()

    def release(self) -> None:
        for part in (self._color_buffer, self._depth_buffer, self.color, self.depth):
            if part is not None:
                part.release()
