"""Screenshots and videos of the canvas: when a frame is kept, and the PNG files."""

import sys
import time
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np

from ...core.base.arguments import plain_message
from ...core.base.paths import free_name, working_folder
from ...core.base.streams import printable
from ...core.field import save
from ..document import save_project, save_session
from ..files import readable, save_surface
from .video import FrameWriter, PictureSeries, VideoWriter, save_png

MESSAGE_SECONDS = 6.0


class Recorder:
    """Keeps frames of the canvas."""

    def __init__(self, canvas, log, fps: int):
        """Take a Canvas, an EventLog, and the frame rate of videos."""
        self.video: FrameWriter | None = None  # that is being recorded
        self.written: list[Path] = []  # files that are finished
        self.failed = False  # whether a file was lost
        self._canvas, self._log, self._fps = canvas, log, fps
        self._said = 0.0, ""  # when, and what
        self.screenshot_path: Path | None = None  # where the frame that is being drawn is kept

    @property
    def message(self) -> str:
        """The message about the last file, for some seconds."""
        said_at, message = self._said
        return message if time.monotonic() - said_at < MESSAGE_SECONDS else ""

    def screenshot(self, path: Path | None = None) -> None:
        """Keep the next frame; by default in the current folder, named by date and time."""
        self.screenshot_path = path or stamped("deformrf", ".png")

    def start(
        self,
        path: Path | None = None,
        live: bool = True,
        codec: str | None = None,
        transparent: bool = False,
    ) -> None:
        """Record from the next frame on; by the clock if live, else frame by frame.

        A path without an ending is a folder, which gets a picture for each frame.
        """
        path = path or stamped("deformrf", ".mp4")
        self.video = self.writer(path, time.monotonic if live else None, codec, transparent)
        self._log("recording", path=path)

    def writer(self, path: Path, clock, codec: str | None, transparent: bool):
        """A VideoWriter of frames of the canvas, or a PictureSeries if the path has no ending."""
        if not path.suffix:
            return PictureSeries(path, self._fps, transparent)
        return VideoWriter(path, self._canvas.size, self._fps, clock, codec, transparent)

    def start_or_stop(self) -> None:
        if self.video is not None:
            self.stop()
            return
        try:
            self.start()
        except (OSError, RuntimeError, ValueError) as error:  # the folder is gone, or read-only
            self._fail(f"can't record: {plain_message(error)}")

    def stop(self, cut_short: bool = False) -> None:
        """Finish the video, if one is being recorded; its name says if it was to be longer."""
        if self.video is None:
            return
        try:
            path = self.video.close(cut_short)
        except RuntimeError as error:
            video, self.video = self.video, None
            if video.frame_count or not cut_short:  # else what cut it short is told of
                self._fail(error)
        else:  # after an interrupt it is still to be finished
            self.video = None
            self.finished(path)

    def add_frame(self) -> None:
        """Add the canvas as it is now to the video, if one is being recorded."""
        if self.video is not None and self.video.due():
            self.add(self._canvas.read())

    def add(self, image) -> None:
        try:
            self.video.push(image)
        except RuntimeError as error:
            video, self.video = self.video, None
            with suppress(RuntimeError):  # the same
                video.close()
            self._fail(error)

    def save_screenshot(self, image=None) -> None:
        """Write an image, by default the canvas as it is now, if a screenshot is wanted."""
        path, self.screenshot_path = self.screenshot_path, None
        if path is not None:
            self._write(path, save_png, path, self._canvas.read() if image is None else image)

    def save_model(self, field) -> None:
        """Write a TetField as a model file into the current folder."""
        path, bits = stamped("model", ".npz"), field.entry_bits or 8  # in training it has no file
        self._write(path, partial(save, field, path, entry_bits=bits))

    def save_surface(self, surface, ending: str, attribution: str = "") -> None:
        """Write an export.SurfaceMesh into the current folder."""
        path = stamped("mesh", ending)
        self._write(path, save_surface, surface, path, attribution)

    def save_session(self, opened, start: dict, path: Path | None = None) -> str:
        """Write what was done to an object, by default into the current folder.

        Returns:
            A sentence if that fails, else an empty string.
        """
        opened.note_view()  # where the last frame has left it
        return self._save(save_session, opened, start, path or stamped("session", ".jsonl"))

    def save_project(self, opened, start: dict, path: Path) -> str:
        """Write a project of an object; returns a sentence if that fails, else an empty string."""
        return self._save(save_project, opened, start, path)

    def _save(self, save, opened, start, path):
        told = []
        problem = self._write(path, save, opened, start, path, told.append)
        for sentence in [] if problem else told:
            self.say(f"wrote {path}, but {sentence}")
        return problem

    def _write(self, path, write, *arguments) -> str:
        """Call what writes a file, and tell of it; returns a sentence if that fails."""
        try:
            write(*arguments)
        except OSError as error:
            self._fail(f"can't write {path}: {error.strerror or error}")
        except ValueError as error:  # a SessionError, as it is too long
            self._fail(str(error))
        else:
            self.finished(path)
            return ""
        return self.message

    def say(self, message: str, stream=None) -> None:
        """Show a message for a while, and print it, by default as what went wrong."""
        message = readable(message)
        self._said = time.monotonic(), message
        print(printable(message), file=stream or sys.stderr, flush=True)

    def finished(self, path: Path) -> None:
        self.written.append(path)
        self._log("written", path=path)
        self.say(f"wrote {path}", sys.stdout)

    def _fail(self, error):
        self.failed = True
        self.say(str(error))


def stamped(stem: str, suffix: str) -> Path:
    """A free name in the current folder: <stem>-<date>-<time>[-2, -3 ..]<suffix>."""
    return free_name(working_folder() / f"{stem}-{time.strftime('%Y%m%d-%H%M%S')}", suffix)


def without_background(image, background):
    """An image of color over a background [3] (0..1) and opacity, with its own color instead.

    Images are [H, W, 4] uint8; the color is black where nothing is.
    """
    color, opacity = image[..., :3].astype(np.float32), image[..., 3:] / np.float32(255.0)
    own = color - 255.0 * np.float32(background) * (1.0 - opacity)
    straight = np.divide(own, opacity, out=np.zeros_like(own), where=opacity > 0)
    straight = np.clip(straight + 0.5, 0.0, 255.0).astype(np.uint8)
    return np.concatenate([straight, image[..., 3:]], axis=-1)
