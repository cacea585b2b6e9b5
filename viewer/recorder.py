"""Frames to an MP4 file that every player opens, and to PNG files.

Encoding runs in a thread behind a short queue.  The file is written as <name>.part.mp4
and renamed when it is complete, since an MP4 that was never closed cannot be read.
Offline, every frame is written; live, frames are repeated or left out by the clock, so
that a second of the clip is a second that the user saw.
"""

import os
import queue
import threading
import time
from pathlib import Path

import numpy as np

QUEUE_LENGTH = 8  # frames; 8 x 1920 x 1080 x 3 bytes = 50 MB
CODEC, QUALITY = "libx264", {"crf": "18", "preset": "veryfast"}
BT_709 = 1  # the number of range "tv", primaries, transfer and matrix alike (H.264, annex E)


class VideoRecorder:
    """An H.264 file that is being written."""

    def __init__(self, path: Path, size: tuple[int, int], fps: int, clock=None):
        """Open the file.

        Args:
            path: Where the finished clip goes, ending in .mp4.
            size: Width and height of the frames; an odd last column or row is cut off, as
                4:2:0 pictures have even sizes.
            fps: Frames per second of the clip.
            clock: A function that returns seconds, for a live recording; None if each
                pushed frame is one frame of the clip.
        """
        import av

        self.path = Path(path)
        self.part = self.path.with_name(self.path.stem + ".part.mp4")
        self.width, self.height = max(size[0] & ~1, 2), max(size[1] & ~1, 2)
        self.fps = fps
        self.frame_count = self.repeated_count = self.dropped_count = 0
        self._clock = clock
        self._start = clock() if clock else 0.0
        self._pending = None  # live: the last image, and the frame number that it starts at
        self._error = None
        self._queue = queue.Queue(QUEUE_LENGTH)
        self._container = av.open(str(self.part), "w", options={"movflags": "+faststart"})
        self._stream = self._container.add_stream(CODEC, rate=fps, options=QUALITY)
        self._stream.width, self._stream.height = self.width, self.height
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.color_range = context.colorspace = BT_709
        context.color_primaries = context.color_trc = BT_709
        self._thread = threading.Thread(target=self._encode, name="recorder", daemon=True)
        self._thread.start()

    @property
    def seconds(self) -> float:
        """How much of the clip there is."""
        if self._clock:
            return self._clock() - self._start
        return self.frame_count / self.fps

    def due(self) -> bool:
        """Whether a frame handed over now would be used."""
        return not self._clock or self._pending is None or self._slot() > self._pending[1]

    def push(self, image) -> None:
        """Add one image [H, W, 3] uint8, top row first.

        Offline it waits for the encoder.  Live it never waits.

        Raises:
            RuntimeError: The encoder failed.
        """
        if self._error:
            raise RuntimeError(self._failure()) from self._error
        image = fitted(image, self.width, self.height)
        if not self._clock:
            self._queue.put((image, 1))
            self.frame_count += 1
            return
        slot = self._slot()
        if self._pending and slot > self._pending[1]:
            self._write_pending(until=slot, wait=False)
        elif self._pending:
            self.dropped_count += 1
            slot = self._pending[1]
        self._pending = image, slot

    def close(self) -> Path:
        """Finish the file and give it its name.

        Raises:
            RuntimeError: The encoder failed; there is no file.
        """
        if self._pending:
            self._write_pending(until=max(self._slot(), self._pending[1] + 1), wait=True)
        self._queue.put(None)
        self._thread.join()
        if self._error:
            self.part.unlink(missing_ok=True)
            raise RuntimeError(self._failure()) from self._error
        os.replace(self.part, self.path)
        return self.path

    def _failure(self):
        """What went wrong in the encoder's thread, in one sentence."""
        if isinstance(self._error, OSError) and self._error.strerror:
            return f"can't write {self.path}: {self._error.strerror}"
        return f"the video encoder failed: {self._error}"

    def _slot(self):
        return int((self._clock() - self._start) * self.fps + 1e-6)

    def _write_pending(self, until, wait):
        """Queue the pending image for the frames up to `until`, which the next one starts."""
        image, _ = self._pending
        count = until - self.frame_count
        try:
            self._queue.put((image, count), block=wait)
        except queue.Full:  # the image after it will stand in for this one
            self.dropped_count += 1
            return
        self.frame_count += count
        self.repeated_count += count - 1

    def _encode(self):
        items = iter(self._queue.get, None)  # None ends the clip
        try:
            written = 0
            for image, count in items:
                frame = _video_frame(image)
                for _ in range(count):
                    frame.pts = written
                    written += 1
                    self._container.mux(self._stream.encode(frame))
            self._container.mux(self._stream.encode(None))
            self._container.close()
        except Exception as error:  # handed to the caller by the next push or by close
            self._error = error
            for _ in items:  # so that no push waits for ever
                pass


def _video_frame(image):
    import av
    from av.video.reformatter import ColorRange, Colorspace

    return av.VideoFrame.from_ndarray(image, format="rgb24").reformat(
        format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
    )


def fitted(image, width: int, height: int):
    """The image centred on a canvas of that size, cut or padded with its corner's color."""
    rows, columns = image.shape[:2]
    if (columns & ~1, rows & ~1) == (width, height):
        return np.ascontiguousarray(image[:height, :width])
    canvas = np.empty((height, width, 3), np.uint8)
    canvas[:] = image[0, 0]
    h, w = min(rows, height), min(columns, width)
    top, left = (height - h) // 2, (width - w) // 2
    y, x = (rows - h) // 2, (columns - w) // 2
    canvas[top : top + h, left : left + w] = image[y : y + h, x : x + w]
    return canvas


def without_background(image, background):
    """An image over a background color as straight color and alpha.

    Args:
        image: Color over the background, and opacity.  [H, W, 4] uint8
        background: 0..1.  [3]

    Returns:
        [H, W, 4] uint8, black where nothing is.
    """
    color, opacity = image[..., :3].astype(np.float32), image[..., 3:] / np.float32(255.0)
    own = color - 255.0 * np.float32(background) * (1.0 - opacity)
    straight = np.divide(own, opacity, out=np.zeros_like(own), where=opacity > 0)
    return np.concatenate(
        [np.clip(straight + 0.5, 0.0, 255.0).astype(np.uint8), image[..., 3:]], axis=-1
    )


def save_png(path: Path, image) -> Path:
    """Write an image [H, W, 3 or 4] uint8, top row first."""
    from PIL import Image

    part = Path(path).with_suffix(".part.png")
    try:
        Image.fromarray(image).save(part)
        os.replace(part, path)
    except BaseException:  # an interrupt leaves no part behind either
        part.unlink(missing_ok=True)
        raise
    return Path(path)


def stamped(stem: str, suffix: str, folder: Path | None = None) -> Path:
    """A name that is not taken yet: <stem>-<date>-<time>[-2, -3 ..]<suffix>."""
    folder = Path.cwd() if folder is None else folder
    base = f"{stem}-{time.strftime('%Y%m%d-%H%M%S')}"
    path, count = folder / f"{base}{suffix}", 1
    while path.exists():
        count += 1
        path = folder / f"{base}-{count}{suffix}"
    return path
