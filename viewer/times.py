"""Times of frames and their stages, for the read-outs and the choice of resolution."""

import time
from collections import deque
from contextlib import contextmanager

import numpy as np

PARTS = ("simulate", "render", "upload", "draw", "panel", "flip")  # of a frame
HISTORY = 120  # frames
RECENT = 9  # frames; few enough to follow what the user does


class FrameTimes:
    """Seconds per frame and per part of a frame, over the last frames."""

    def __init__(self):
        self.frames = deque([0.0], maxlen=HISTORY)
        self.rendering: dict[str, float] = {}  # the renderer's stages in the last image
        self._parts = {part: deque([0.0], maxlen=HISTORY) for part in PARTS}
        self._now = dict.fromkeys(PARTS, 0.0)
        self._last = None

    @contextmanager
    def part(self, name: str):
        """Add the time spent inside to one part of the present frame."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._now[name] += time.perf_counter() - start

    def end_frame(self) -> None:
        """Close the present frame; it began when the one before was closed."""
        now = time.perf_counter()
        if self._last is not None:
            self.frames.append(now - self._last)
        for name, value in self._now.items():
            self._parts[name].append(value)
        self.rest()
        self._last = now

    def rest(self) -> None:
        """No frame follows for a while: the time until the next one belongs to no frame."""
        self._last = None
        self._now = dict.fromkeys(PARTS, 0.0)

    def recent(self, parts) -> float:
        """Median seconds that these parts took together in the last few frames."""
        return float(np.median(np.sum([list(self._parts[p])[-RECENT:] for p in parts], axis=0)))

    def frame_seconds(self) -> float:
        """Mean length of the last frames."""
        return float(np.mean(self.frames))

    def medians(self) -> dict[str, float]:
        """Median seconds per part over the last frames."""
        return {name: float(np.median(values)) for name, values in self._parts.items()}
