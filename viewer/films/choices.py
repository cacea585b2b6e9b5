"""What a user chooses about a film, and the arguments of deformrf render that say so."""

import math
import os
from dataclasses import dataclass
from pathlib import Path

from ...core.base.paths import free_name, working_folder
from ..settings import LARGEST_SIDE, SMALLEST_SIDE

KINDS = {  # what is filmed
    "take": "What was recorded",
    "timeline": "The timeline",
    "all": "All that was done",
    "turntable": "A turn around the object",
}
AS_WINDOW, FREE = "as the window", "free"
SIZES = AS_WINDOW, "1280x720", "1920x1080", "3840x2160", "1080x1080", "1080x1920", FREE
RATES = 15, 24, 25, 30, 60  # frames a second
SAMPLE_COUNTS = 1, 4, 16, 64
BLUR = 0.5  # of a frame's time, as film cameras have it
LARGEST_RATIO = 32  # whose numbers are told, as in 16:9
TURN_SECONDS = 1.0, 60.0
FORMATS = {  # what a user may choose: the ending of the file's name
    "MP4 (H.264)": ".mp4",
    "WebM (VP9)": ".webm",
    "WebP": ".webp",
    "PNG files": "",
}


@dataclass
class FilmChoices:
    """What the window "Save film" asks for."""

    name: str = ""  # of the file, without its ending
    size: str = SIZES[2]
    fps: int = 30
    samples: int = 4
    blur: bool = False
    format: str = "MP4 (H.264)"
    transparent: bool = False
    handles: bool = False
    what: str = "all"  # one of KINDS
    turn_seconds: float = 6.0
    free_size: tuple[int, int] = (1280, 720)  # if `size` is FREE
    folder: str = ""  # empty: the current one

    @property
    def path(self) -> Path:
        """The file, or the folder of pictures."""
        return Path(f"{self._stem}{self.ending}")

    @property
    def session(self) -> Path:
        """The file for the session, beside the film: a free name."""
        return free_name(self._stem, ".jsonl")

    @property
    def _stem(self):
        folder = working_folder() / os.path.expanduser(self.folder)
        return folder / self.name.removesuffix(self.ending)

    @property
    def ending(self) -> str:
        return FORMATS[self.format]

    @property
    def can_be_transparent(self) -> bool:
        return self.format != "MP4 (H.264)"

    def pixels(self, window_size) -> tuple[int, int]:
        """Width and height, which are even."""
        width, height = self._sides(window_size)
        return width & ~1, height & ~1

    def _sides(self, window_size):
        chosen = {AS_WINDOW: window_size, FREE: self.free_size}.get(self.size)
        return tuple(chosen or map(int, self.size.split("x")))

    def size_problem(self, window_size) -> str:
        """Why no film has this size; empty if it is good."""
        width, height = self.pixels(window_size)
        if SMALLEST_SIDE <= min(width, height) and max(width, height) <= LARGEST_SIDE:
            return ""
        return f"{width} x {height}: both sides have to be {SMALLEST_SIDE} to {LARGEST_SIDE}"

    def size_line(self, window_size) -> str:
        """Width, height and their ratio; or that they were odd, or why they can't be."""
        width, height = self.pixels(window_size)
        shared = max(math.gcd(width, height), 1)
        ratio = f"{width // shared}:{height // shared}"
        if max(width, height) // shared > LARGEST_RATIO:
            ratio = f"{width / max(height, 1):.2f}:1"
        is_even = (width, height) == self._sides(window_size)
        line = f"{width} x {height}, {ratio}" + ("" if is_even else "; a film's sides are even")
        return self.size_problem(window_size) or line

    def arguments(self, window_size, session: Path, take: tuple[int, int] | None) -> list[str]:
        """Those of deformrf render, without the film's file.

        Args:
            session: The session's file.
            take: The first and the last tick, if that is what is filmed.
        """
        chosen = ["--size", "{}x{}".format(*self.pixels(window_size)), "--fps", str(self.fps)]
        chosen += ["--samples", str(self.samples)]
        if self.blur and self.samples > 1:
            chosen += ["--shutter", str(BLUR)]
        if self.transparent and self.can_be_transparent:
            chosen += ["--transparent"]
        if not self.handles:
            chosen += ["--hide-handles"]
        if self.what == "turntable":  # which shows no handles by default
            chosen += ["--show-handles"] if self.handles else []
            return [*chosen, "--pose", str(session), "--turntable", f"{self.turn_seconds:g}"]
        chosen += ["--session", str(session)]
        if self.what == "take":
            chosen += ["--from", str(take[0]), "--to", str(take[1])]
        return [*chosen, "--timeline"] if self.what == "timeline" else chosen
