"""Writes images to a video file, or to a folder of numbered pictures.

A thread converts and encodes behind a short queue, so that the next image can be made
meanwhile.  A file is written as .<name>-<random>.part.mp4 and renamed when it is complete, since
no player reads an MP4 that was never closed.  Pictures go into a folder <name>.part until all are
there.  What is finished though more was to come has "(cut short)" in its name.

Without a clock each image is one frame of the video; with a clock images are repeated or dropped,
so that a second of the video shows a second of the clock.

A transparent image has four channels, and its color is what it adds to the one behind it
(premultiplied by the opacity).  Files have the color itself (straight alpha).
"""

import os
import queue
import threading
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...core.base.device import thread_count
from ...core.base.paths import discard, free_name, reserved, sync, target_of, whole_file

QUEUE_LENGTH, QUEUE_BYTES = 8, 256 * 2**20  # images that wait, and about their size
PNG_LEVEL = 4  # of zlib: twice as fast as the usual 6, a few percent larger
BT_709 = 1  # the number of range "tv", primaries, transfer and matrix alike (H.264, annex E)


class Encoder(NamedTuple):
    """One of FFmpeg's encoders."""

    name: str
    options: dict
    endings: tuple[str, ...]  # of files that hold its video
    pixels: str = "yuv420p"
    transparent: str = ""  # pixels that have an opacity, if it knows any


CODECS = {  # as a user calls them
    "h264": Encoder("libx264", {"crf": "18", "preset": "veryfast"}, (".mp4",)),
    "h265": Encoder(
        "libx265", {"crf": "20", "preset": "fast", "x265-params": "log-level=error"}, (".mp4",)
    ),
    "av1": Encoder("libsvtav1", {"crf": "28", "preset": "9"}, (".mp4", ".webm")),
    "vp9": Encoder(
        "libvpx-vp9",
        # auto-alt-ref: frames that are never shown have no opacity
        {"crf": "28", "b": "0", "cpu-used": "5", "row-mt": "1", "tile-columns": "4"}
        | {"auto-alt-ref": "0"},
        (".webm",),
        transparent="yuva420p",
    ),
    "webp": Encoder("libwebp_anim", {"quality": "85"}, (".webp",), "bgra", "bgra"),
}
ENDINGS = {".mp4": "h264", ".webm": "vp9", ".webp": "webp"}  # and their usual codecs


def encoder(path: Path, codec: str | None = None, transparent: bool = False) -> Encoder:
    """The encoder for a file, by default the usual one for its ending.

    Raises:
        ValueError: There is none, it doesn't go into such a file, or it knows no opacity.
    """
    import av

    codec = codec or ENDINGS.get(path.suffix)
    if codec is None or path.suffix not in CODECS[codec].endings:
        endings = " or ".join(CODECS[codec].endings if codec else ENDINGS)
        raise ValueError(f"{path}: a video file has to end in {endings}")
    chosen = CODECS[codec]
    if transparent and not chosen.transparent:
        able = " or ".join(name for name, one in CODECS.items() if one.transparent)
        raise ValueError(f"{codec} has no opacity; {able}, or a folder of pictures, has it")
    try:
        av.Codec(chosen.name, "w")
    except ValueError as error:  # av's own is one
        message = f"this machine's PyAV has no encoder for {codec} ({chosen.name})"
        raise ValueError(message) from error
    return chosen


class FrameWriter:
    """A file or a folder at `partial` that frames are written to until it gets its name, `path`."""

    repeated_count = dropped_count = 0  # frames that are repeats; images that were left out

    def __init__(self, path: Path, target: Path, partial: Path, fps: int, transparent: bool):
        """Take its path and what lies there, as behind a link."""
        self.path, self._target, self.partial = path, target, partial
        self.fps, self._transparent = fps, transparent
        self.frame_count = 0  # that are written, or wait for it
        self.encoding_seconds = 0.0  # of all threads together
        self._ended = self._named = False  # no image comes any more; it gets its name

    @property
    def seconds(self) -> float:
        """Its length so far."""
        return self.frame_count / self.fps

    def due(self) -> bool:
        """Whether an image that is pushed now would become a frame."""
        return True

    def close(self, cut_short: bool = False) -> Path:
        """Finish it and give it its name, or that of one that was to be longer.

        After an interrupt it can be called again, and goes on as the first call would have.

        Raises:
            RuntimeError: Frames can't be written, or there is none, and no file.
        """
        if cut_short and not self._ended:
            self.path = self._target = free_name(
                self.path.with_name(f"{self.path.stem} (cut short)"), self.path.suffix
            )
        self._ended = True
        self._finish()
        if not self.frame_count:  # an older file is better
            self._discard()
            raise RuntimeError(f"{self.path} was not written: it would have no frame")
        try:
            if self.partial.exists() or not self._named:
                self._settle()
                self._named = True
                self.partial.replace(self._target)
        except OSError as error:  # its folder was deleted, say
            lost = self._discard()
            raise RuntimeError(f"can't write {self.path}: {error.strerror}{lost}") from error
        return self.path

    def _finish(self):
        """Wait until all images are written; raises a RuntimeError if one can't be."""

    def _settle(self):
        """All is written: make it ready for its name."""

    def _discard(self) -> str:
        """There will be no such file; returns where its frames are, if they are kept."""


class VideoWriter(FrameWriter):
    """A video file that is being written."""

    def __init__(
        self,
        path: Path,
        size: tuple[int, int],
        fps: int,
        clock=None,
        codec: str | None = None,
        transparent: bool = False,
    ):
        """Open the file; a clock is a function that returns seconds.

        An odd last column or row of the images is cut off, as 4:2:0 pictures have even sizes.

        Raises:
            ValueError: There is no encoder for it.
            OSError: The file can't be opened.
        """
        path, target = Path(path), target_of(Path(path))
        chosen = encoder(path, codec, transparent)
        # Or it prints its version.  It is read when the encoder opens.
        os.environ.setdefault("SVT_LOG", "1")
        try:
            partial = reserved(target)
        except OSError:  # the encoder finds the same, and says so with the first image
            partial = target.with_name(f".{path.stem}.part{path.suffix}")
        super().__init__(path, target, partial, fps, transparent)
        self.width, self.height = self._size = max(size[0] & ~1, 2), max(size[1] & ~1, 2)
        self._clock = clock
        self._start = clock() if clock else 0.0
        self._pending = None  # with a clock: the last image, and the frame number it starts at
        self._error = None
        self._queue = queue.Queue(waiting(self.width, self.height))  # of (image, how many frames)
        try:
            self._open(chosen)
        except BaseException:
            discard(self.partial)
            raise

    def _open(self, chosen):
        import av

        options = {".mp4": {"movflags": "+faststart"}, ".webp": {"loop": "0"}}
        self._container = av.open(str(self.partial), "w", options=options.get(self.path.suffix, {}))
        self._stream = self._container.add_stream(
            chosen.name, rate=self.fps, options=chosen.options
        )
        self._stream.width, self._stream.height = self.width, self.height
        self._stream.pix_fmt = chosen.transparent if self._transparent else chosen.pixels
        if self._transparent:
            self._stream.metadata["alpha_mode"] = "1"  # how WebM says it
        context = self._stream.codec_context
        context.thread_type = "AUTO"  # PyAV's default divides each frame, which takes longer
        if chosen.pixels == "yuv420p":
            context.color_range = context.colorspace = BT_709
            context.color_primaries = context.color_trc = BT_709
        self._thread = threading.Thread(target=self._encode, name="video", daemon=True)
        self._thread.start()

    @property
    def seconds(self) -> float:
        return self._clock() - self._start if self._clock else super().seconds

    def due(self) -> bool:
        return self._pending is None or self._now() > self._pending[1]

    def push(self, image) -> None:
        """Add an image [H, W, 3 or 4] uint8, top row first, which may not change any more.

        Without a clock, wait for the encoder while many images wait for it.

        Raises:
            RuntimeError: The encoder failed.
        """
        if self._error:
            raise self._failure() from self._error
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

    def _finish(self):
        if self._pending:
            self._queue_pending(until=max(self._now(), self._pending[1] + 1), wait=True)
            self._pending = None
        if self._thread.is_alive():
            self._queue.put(None)
        self._thread.join()
        if self._error and self.frame_count:
            self._discard()
            raise self._failure() from self._error

    def _settle(self):
        sync(self.partial)

    def _discard(self):
        discard(self.partial)
        return ""

    def _failure(self):
        """The error of the encoder's thread, in one sentence."""
        if isinstance(self._error, OSError) and self._error.strerror:
            return RuntimeError(f"can't write {self.path}: {self._error.strerror}")
        return RuntimeError(f"the video encoder failed: {self._error}")

    def _now(self):
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
        from av.video.reformatter import VideoReformatter

        convert = VideoReformatter()
        items = iter(self._queue.get, None)  # None ends the video
        try:
            written = 0
            for image, count in items:
                start = time.perf_counter()
                image = fitted(straight(image) if self._transparent else image, *self._size)
                frame = _video_frame(image, self._stream.pix_fmt, convert)
                for _ in range(count):
                    frame.pts = written
                    written += 1
                    self._container.mux(self._stream.encode(frame))
                self.encoding_seconds += time.perf_counter() - start
            start = time.perf_counter()
            self._container.mux(self._stream.encode(None))
            self._container.close()
            self.encoding_seconds += time.perf_counter() - start
        except Exception as error:  # handed to the caller by the next push or by close
            self._error = error
            for _ in items:  # so that no push waits for ever
                pass


class PictureSeries(FrameWriter):
    """A folder of PNG files 00000.png, 00001.png ... that is being filled, one for each frame."""

    def __init__(self, path: Path, fps: int, transparent: bool = False):
        """Take a folder that is empty or not there yet."""
        path = Path(path)
        super().__init__(path, path, free_name(path, ".part"), fps, transparent)
        self._pool = ThreadPoolExecutor(thread_count())  # zlib runs beside the interpreter
        self._waiting = deque()  # futures
        self.partial.mkdir(parents=True)

    def push(self, image) -> None:
        """Add an image [H, W, 3 or 4] uint8, top row first, which may not change any more.

        Raises:
            RuntimeError: One of the last ones can't be written.
        """
        path = self.partial / f"{self.frame_count:05d}.png"
        self._waiting.append(self._pool.submit(self._save, path, image))
        self.frame_count += 1
        self._wait(waiting(*image.shape[:2]))

    def _finish(self):
        try:
            self._wait(0)
        except Exception:
            self._pool.shutdown(cancel_futures=True)
            raise
        self._pool.shutdown()

    def _settle(self):
        if self.path.is_dir():
            self.path.rmdir()  # it was there, and empty

    def _discard(self):
        with suppress(OSError):  # it has pictures
            self.partial.rmdir()
        return f"; the pictures are in {self.partial}"

    def _wait(self, count):
        """Wait until no more than that many images are being written."""
        while len(self._waiting) > count:
            self.encoding_seconds += self._waiting[0].result()
            self._waiting.popleft()

    def _save(self, path, image):
        start = time.perf_counter()
        try:
            save_png(path, straight(image) if self._transparent else image)
        except OSError as error:
            raise RuntimeError(f"can't write {path}: {error.strerror or error}") from error
        return time.perf_counter() - start


def waiting(width: int, height: int) -> int:
    """How many images of that size may wait for their encoder."""
    return min(max(QUEUE_BYTES // (4 * width * height), 2), QUEUE_LENGTH)


def save_png(path: Path, image) -> Path:
    """Write an image [H, W, 3 or 4] uint8, top row first; it appears when it is complete."""
    from PIL import Image

    path = Path(path)
    with whole_file(path) as partial:
        Image.fromarray(image).save(partial, "PNG", compress_level=PNG_LEVEL)
    return path


def straight(image):
    """The color itself of a transparent image [H, W, 4] uint8, whose color is premultiplied."""
    image = np.array(image)
    opacity = image[..., 3]
    rows, columns = np.nonzero((opacity > 0) & (opacity < 255))  # few
    over = image[rows, columns, :3].astype(int)
    share = opacity[rows, columns, None].astype(int)
    image[rows, columns, :3] = np.minimum((255 * over + share // 2) // share, 255)
    return image


def _video_frame(image, pixels, convert):
    """PyAV's frame of an image; `convert` is the VideoReformatter of all of them."""
    import av
    from av.video.reformatter import ColorRange, Colorspace

    frame = av.VideoFrame.from_ndarray(image, format="rgba" if image.shape[-1] == 4 else "rgb24")
    if pixels == "bgra":
        return convert.reformat(frame, format=pixels)
    colors = {"dst_colorspace": Colorspace.ITU709, "dst_color_range": ColorRange.MPEG}
    return convert.reformat(frame, format=pixels, threads=thread_count(), **colors)


def fitted(image, width: int, height: int):
    """The image centered on a canvas of that size, cut or padded with its corner's color."""
    rows, columns = image.shape[:2]
    if (columns & ~1, rows & ~1) == (width, height):
        return np.ascontiguousarray(image[:height, :width])
    from PIL import Image

    picture = Image.fromarray(image)
    canvas = Image.new(picture.mode, (width, height), tuple(image[0, 0].tolist()))
    canvas.paste(picture, (int((width - columns) / 2), int((height - rows) / 2)))
    return np.asarray(canvas)
