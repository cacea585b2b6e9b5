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
    """Send a small image through shared memory; raise if it does not arrive."""
    color = np.arange(4 * PROBE_SIZE * PROBE_SIZE, dtype=np.uint8).reshape(PROBE_SIZE, -1, 4)
    depth = np.arange(PROBE_SIZE * PROBE_SIZE, dtype=np.float32).reshape(PROBE_SIZE, -1)
    size = PROBE_SIZE, PROBE_SIZE
    buffer = SharedBuffer(ctx, device, size)
    textures = ctx.texture(size, 4), ctx.texture(size, 1, dtype="f4")
    try:
        sent = wp.array(color, dtype=wp.vec4ub, device=device), wp.array(depth, device=device)
        buffer.write(sent, textures, None)
        if [texture.read() for texture in textures] != [color.tobytes(), depth.tobytes()]:
            raise RuntimeError("what was written is not what was read")
    finally:
        for part in (buffer, *textures):
            part.release()


class SharedBuffer:
    """An OpenGL pixel buffer that CUDA writes and textures read.

    To map it for CUDA takes longer than to copy an image, so an image is one mapping.
    """

    def __init__(self, ctx: moderngl.Context, device: str, size: tuple[int, int]):
        """Make room for two arrays of 4 bytes a pixel."""
        if not wp.get_device(device).is_cuda:
            raise RuntimeError("the renderer runs on the CPU")
        self._ctx, byte_count = ctx, 4 * size[0] * size[1]
        self._buffer = ctx.buffer(reserve=2 * byte_count, dynamic=True)
        self._second = ctx.buffer(reserve=byte_count, dynamic=True)  # textures read from the start
        self._shared = None
        try:
            self._shared = wp.RegisteredGLBuffer(
                self._buffer.glo,
                device,
                flags=wp.RegisteredGLBuffer.WRITE_DISCARD,
                fallback_to_copy=False,
            )
        except BaseException:
            self.release()
            raise

    def write(self, arrays, textures, viewport) -> None:
        """Put one or two arrays of one shape into as many textures."""
        byte_count = 4 * arrays[0].size
        mapped = self._shared.map(dtype=wp.uint8, shape=(len(arrays) * byte_count,))
        for index, array in enumerate(arrays):
            start = mapped.ptr + index * byte_count
            room = wp.array(ptr=start, dtype=array.dtype, shape=array.shape, device=array.device)
            wp.copy(room, array)
        self._shared.unmap()
        textures[0].write(self._buffer, viewport=viewport)
        for texture in textures[1:]:
            self._ctx.copy_buffer(self._second, self._buffer, byte_count, read_offset=byte_count)
            texture.write(self._second, viewport=viewport)

    def release(self) -> None:
        self._shared = None  # unregistered before OpenGL deletes the buffer
        self._buffer.release()
        self._second.release()


class ImageTexture:
    """A color and a depth texture of one size, filled by strips of rows."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], device: str, path: str):
        # Without a buffer, the host copies.
        self._buffer = SharedBuffer(ctx, device, size) if path == "buffer" else None
        self.size = size
        self.color = ctx.texture(size, 4, dtype="f1")
        self.color.filter = moderngl.LINEAR, moderngl.LINEAR
        self.depth = ctx.texture(size, 1, dtype="f4")
        self.depth.filter = moderngl.NEAREST, moderngl.NEAREST  # inf must not be blended
        for texture in (self.color, self.depth):
            texture.repeat_x = texture.repeat_y = False
        self._pinned = {}  # memory of the host that CUDA copies to, by the pixels' type

    def write_color(self, color, first_row: int = 0) -> None:
        """Put colors [h, w] vec4ub at `first_row`, counted from the top."""
        self._write([color], [self.color], first_row)

    def write(self, image, first_row: int = 0) -> None:
        """Put an Image of core/render at `first_row`, counted from the top."""
        self._write([image.color, image.depth], [self.color, self.depth], first_row)

    def _write(self, arrays, textures, first_row):
        height, width = arrays[0].shape
        assert width == self.size[0] and first_row + height <= self.size[1], arrays[0].shape
        viewport = 0, first_row, width, height
        if self._buffer is not None:
            self._buffer.write(arrays, textures, viewport)
            return
        for texture, pixels in zip(textures, arrays, strict=True):
            texture.write(self._on_host(pixels), viewport=viewport)

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
        for part in (self._buffer, self.color, self.depth):
            if part is not None:
                part.release()
