"""The making of a film: each frame is played, rendered on the device, drawn and encoded.

OpenGL draws a frame while the device renders the next one, since its image is read only then, and
a thread encodes (video.py).  No frame is dropped.
"""

import time
from dataclasses import dataclass
from typing import Protocol

from ...core.render import StageTimer
from ..layers import Canvas, RadianceLayer
from .film import Film
from .recorder import Recorder

STEPS = "playing", "rendering", "drawing", "waiting"


@dataclass(frozen=True)
class FilmOptions:
    """How a film is rendered, whatever it shows."""

    samples: int = 1  # images a frame
    shutter: float = 0.0  # the share of a frame's time that they are spread over
    transparent: bool = False
    show_handles: bool = True
    mode: str | None = None  # None: what the session shows


class Stage(Protocol):
    """Where frames are drawn and kept: what a FilmMaker needs of the App."""

    size: tuple[int, int]  # of the canvas [pixels]
    canvas: Canvas
    radiance: RadianceLayer
    recorder: Recorder

    def draw(self, camera, keep: bool) -> None: ...


class FilmMaker:
    """Writes the frames of a Film into the video that a recorder has started."""

    def __init__(self, stage: Stage, film: Film, options: FilmOptions):
        self._step = StageTimer("cpu")
        self.seconds = self._step.seconds = dict.fromkeys(STEPS, 0.0)
        self.made = 0  # frames
        self._stage, self._film, self._options = stage, film, options
        self._drawn = False  # a frame that was not read yet
        self._since = time.perf_counter()
        stage.radiance.transparent = options.transparent

    def make(self, frame: int) -> bool:
        """Make the next frame; whether files can still be written."""
        stage, options = self._stage, self._options
        settings = self._film.scene.settings
        with self._step("playing"):
            self._film.show(frame)
            settings.show_handles &= options.show_handles
            settings.show_bones &= options.show_handles
            settings.mode = options.mode or settings.mode
            moments = self._film.moments(frame, stage.size, options.samples, options.shutter)
        with self._step("rendering"):
            stage.radiance.render_mean(moments)
        self.finish()
        with self._step("drawing"):
            stage.radiance.upload()
            stage.draw(moments[-1][0], keep=False)
            stage.canvas.flush()
        self._drawn = True
        return not stage.recorder.failed

    def finish(self) -> None:
        """Hand the frame that was drawn to the encoder."""
        if not self._drawn or self._stage.recorder.video is None:  # which a full disk has ended
            return
        self._drawn = False
        with self._step("drawing"):
            image = self._stage.canvas.read(4 if self._options.transparent else 3)
        with self._step("waiting"):
            self._stage.recorder.add(image)
        self.made += 1

    def report(self, encoding: float) -> str:
        """What took how long, in one line; `encoding` has the seconds of the encoder's thread."""
        total, count = time.perf_counter() - self._since, max(self.made, 1)
        said = [
            f"{name} {seconds:.1f} s ({1e3 * seconds / count:.0f} ms a frame)"
            for name, seconds in {**self.seconds, "encoding beside it": encoding}.items()
        ]
        return f"{self.made} frames in {total:.1f} s: {', '.join(said)}"
