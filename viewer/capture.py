"""Screenshots and clips of the canvas, in the order in which a frame is drawn."""

import sys
import time
from pathlib import Path

from .recorder import VideoRecorder, save_png, stamped


class Capture:
    """What is to be read from the canvas in this frame and the next ones.

    Attributes:
        written: Files that are finished.
        failed: Whether a clip or a screenshot was lost.
    """

    def __init__(self, canvas, status, log):
        self.written: list[Path] = []
        self.failed = False
        self._canvas, self._status, self._log = canvas, status, log
        self._screenshot: Path | None = None

    @property
    def wants_screenshot(self) -> bool:
        """Whether the frame that is being drawn is to be kept."""
        return self._screenshot is not None

    def screenshot(self, path: Path | None = None) -> None:
        """Keep the next frame; in the current folder with the time as its name by default."""
        self._screenshot = path or stamped("deformrf", ".png")

    def start(self, fps: int, path: Path | None = None, live: bool = True) -> None:
        """Record from the next frame on; live by the clock, else frame by frame."""
        path = path or stamped("deformrf", ".mp4")
        clock = time.monotonic if live else None
        self._status.recorder = VideoRecorder(path, self._canvas.size, fps, clock)
        self._log("recording", path=path)

    def stop(self) -> None:
        """Finish the clip, if one is being recorded."""
        recorder, self._status.recorder = self._status.recorder, None
        if recorder is not None:
            try:
                self._finished(recorder.close())
            except RuntimeError as error:
                self._fail(error)

    def view_drawn(self) -> None:
        """The view is complete, the panel is not there yet: a frame of the clip."""
        recorder = self._status.recorder
        if recorder is None or not recorder.due():
            return
        try:
            recorder.push(self._canvas.read())
        except RuntimeError:  # stopping reports it
            self.stop()

    def save_screenshot(self, image=None) -> None:
        """Write an image, by default the canvas as it is now, if a screenshot is wanted."""
        if self._screenshot is not None:
            path, self._screenshot = self._screenshot, None
            image = self._canvas.read() if image is None else image
            try:
                self._finished(save_png(path, image))
            except OSError as error:
                self._fail(f"can't write {path}: {error.strerror or error}")

    def _finished(self, path):
        self.written.append(path)
        self._status.say(f"wrote {path}")
        self._log("written", path=path)
        print(f"wrote {path}", flush=True)

    def _fail(self, error):
        self.failed = True
        self._status.say(str(error))
        print(error, file=sys.stderr, flush=True)
