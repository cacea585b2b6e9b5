"""Writes images to a video file, or to a folder of numbered pictures.

A thread encodes behind a short queue.  A file is written as <name>.part.mp4 and renamed
when it is complete, since no player reads an MP4 that was never closed.  Without a clock
each image is one frame of the video; with a clock images are repeated or dropped, so that
a second of the video shows a second of the clock.
"""

import os
import queue
import threading
from pathlib import Path

import numpy as np

from ..core.paths import whole_file

QUEUE_LENGTH = 8  # frames; 8 x 1920 x 1080 x 3 bytes = 50 MB
CODECS = {  # as a user calls them: the encoder, its options, and the files that hold its video
    "h264": ("libx264", {"crf": "18", "preset": "veryfast"}, (".mp4",)),
    "h265": (
        "libx265",
        {"crf": "20", "preset": "fast", "x265-params": "log-level=error"},
        (".mp4",),
    ),
    "av1": ("libsvtav1", {"crf": "28", "preset": "9"}, (".mp4", ".webm")),
    "vp9": ("libvpx-vp9", {"crf": "28", "b": "0", "cpu-used": "4", "row-mt": "1"}, (".webm",)),
}
ENDINGS = {".mp4": "h264", ".webm": "vp9"}  # and their usual codecs
BT_709 = 1  # the number of range "tv", primaries, transfer and matrix alike (H.264, annex E)


def encoder(path: Path, codec: str | None = None) -> tuple[str, dict]:
    """The encoder for a file, by default the usual one for its ending, and its options.

    Raises:
        ValueError: There is none, or it doesn't go into such a file.
    """
    import av

    codec = codec or ENDINGS.get(path.suffix)
    if codec is None or path.suffix not in CODECS[codec][2]:
        endings = " or ".join(CODECS[codec][2] if codec else ENDINGS)
        raise ValueError(f"{path}: a video file has to end in {endings}")
    name, options, _ = CODECS[codec]
    try:
        av.Codec(name, "w")
    except ValueError as error:  # av's own is one
        raise ValueError(f"this machine's PyAV has no encoder for {codec} ({name})") from error
    return name, options


class VideoWriter:
    """A video file that is being written."""

    def __init__(self, path: Path, size: tuple[int, int], fps: int, clock=None, codec=None):
        """Open the file; a clock is a function that returns seconds.

        An odd last column or row of the images is cut off, as 4:2:0 pictures have even sizes.

        Raises:
            ValueError: There is no encoder for it.
        """
        import av

        self.path = Path(path)
        name, quality = encoder(self.path, codec)
        self.part = self.path.with_name(f"{self.path.stem}.part{self.path.suffix}")
        self.width, self.height = max(size[0] & ~1, 2), max(size[1] & ~1, 2)
        self.fps = fps
        self.frame_count = 0  # in the file, or queued for it
        self.repeated_count = self.dropped_count = 0  # frames that are repeats; images left out
        self._clock = clock
        self._start = clock() if clock else 0.0
        self._pending = None  # with a clock: the last image, and the frame number it starts at
        self._error = None
        self._queue = queue.Queue(QUEUE_LENGTH)  # of (image, how many frames show it)
        options = {"movflags": "+faststart"} if self.path.suffix == ".mp4" else {}
        self._container = av.open(str(self.part), "w", options=options)
        self._stream = self._container.add_stream(name, rate=fps, options=quality)
        self._stream.width, self._stream.height = self.width, self.height
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.color_range = context.colorspace = BT_709
        context.color_primaries = context.color_trc = BT_709
        self._thread = threading.Thread(target=self._encode, name="video", daemon=True)
        self._thread.start()

    @property
    def seconds(self) -> float:
        """Length of the video so far."""
        if self._clock:
            return self._clock() - self._start
        return self.frame_count / self.fps

    def due(self) -> bool:
        """Whether an image that is pushed now would become a frame."""
        return self._pending is None or self._now() > self._pending[1]

    def push(self, image) -> None:
        """Add an image [H, W, 3] uint8, top row first; wait for the encoder if there is no clock.

        Raises:
            RuntimeError: The encoder failed.
        """
        if self._error:
            raise self._failure() from self._error
        image = fitted(image, self.width, self.height)
        if not self._clock:
            self._queue.put((image, 1))
            self.frame_count += 1
            return
        number = self._now()
        if self._pending and number > self._pending[1]:
            self._queue_pending(until=number, wait=False)
        elif self._pending:
            self.dropped_count += 1
            number = self._pending[1]
        self._pending = image, number

    def close(self) -> Path:
        """Finish the file and give it its name.

        Raises:
            RuntimeError: The encoder failed; there is no file.
        """
        if self._pending:
            self._queue_pending(until=max(self._now(), self._pending[1] + 1), wait=True)
        self._queue.put(None)
        self._thread.join()
        if self._error:
            self.part.unlink(missing_ok=True)
            raise self._failure() from self._error
        os.replace(self.part, self.path)
        return self.path

    def _failure(self):
        """The error of the encoder's thread, in one sentence."""
        if isinstance(self._error, OSError) and self._error.strerror:
            return RuntimeError(f"can't write {self.path}: {self._error.strerror}")
        return RuntimeError(f"the video encoder failed: {self._error}")

    def _now(self):
        """The number of the frame that the clock is at."""
        return int((self._clock() - self._start) * self.fps + 1e-6)

    def _queue_pending(self, until, wait):
        """Queue the pending image for all frames before number `until`."""
        count = until - self.frame_count
        try:
            self._queue.put((self._pending[0], count), block=wait)
        except queue.Full:  # the next image will also take this one's frames
            self.dropped_count += 1
            return
        self.frame_count += count
        self.repeated_count += count - 1

    def _encode(self):
        items = iter(self._queue.get, None)  # None ends the video
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


class PictureSeries:
    """A folder of PNG files 00000.png, 00001.png ... that is being filled, one for each frame."""

    repeated_count = dropped_count = 0

    def __init__(self, path: Path, fps: int):
        """Take a folder, which may not be there yet."""
        self.path, self.fps, self.frame_count = Path(path), fps, 0
        self.path.mkdir(parents=True, exist_ok=True)

    @property
    def seconds(self) -> float:
        return self.frame_count / self.fps

    def due(self) -> bool:
        return True

    def push(self, image) -> None:
        """Write an image [H, W, 3 or 4] uint8, top row first.

        Raises:
            RuntimeError: It can't be written.
        """
        path = self.path / f"{self.frame_count:05d}.png"
        try:
            save_png(path, image)
        except OSError as error:
            raise RuntimeError(f"can't write {path}: {error.strerror or error}") from error
        self.frame_count += 1

    def close(self) -> Path:
        return self.path


def save_png(path: Path, image) -> Path:
    """Write an image [H, W, 3 or 4] uint8, top row first; it appears when it is complete."""
    from PIL import Image

    path = Path(path)
    with whole_file(path) as partial:
        Image.fromarray(image).save(partial, "PNG")
    return path


def _video_frame(image):
    import av
    from av.video.reformatter import ColorRange, Colorspace

    return av.VideoFrame.from_ndarray(image, format="rgb24").reformat(
        format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
    )


def fitted(image, width: int, height: int):
    """The image centered on a canvas of that size, cut or padded with its corner's color."""
    rows, columns = image.shape[:2]
    if (columns & ~1, rows & ~1) == (width, height):
        return np.ascontiguousarray(image[:height, :width])
    from PIL import Image

    canvas = Image.new("RGB", (width, height), tuple(image[0, 0].tolist()))
    canvas.paste(Image.fromarray(image), (int((width - columns) / 2), int((height - rows) / 2)))
    return np.asarray(canvas)
