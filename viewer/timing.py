"""How long the stages of a frame take, for the read-out in the panel."""

import time
from collections import deque
from contextlib import contextmanager

import numpy as np

STAGES = ("simulate", "render", "upload", "draw", "panel", "flip")
HISTORY = 120  # frames
RECENT = 9  # frames; few enough to follow what the user does


class StageTimes:
    """Seconds per stage and per frame, over the last frames.

    Attributes:
        rendering: Seconds of each stage within the last image, if they are measured.
    """

    def __init__(self):
        self.frames = deque([0.0], maxlen=HISTORY)
        self._stages = {stage: deque([0.0], maxlen=HISTORY) for stage in STAGES}
        self._now = dict.fromkeys(STAGES, 0.0)
        self._last = None
        self.rendering: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str):
        """Adds the time spent inside to one stage of the present frame."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._now[name] += time.perf_counter() - start

    def end_frame(self) -> float:
        """Close the present frame; its length in seconds, from the end of the one before."""
        now = time.perf_counter()
        seconds = 0.0 if self._last is None else now - self._last
        if self._last is not None:
            self.frames.append(seconds)
        self._last = now
        for name, value in self._now.items():
            self._stages[name].append(value)
        self._now = dict.fromkeys(STAGES, 0.0)
        return seconds

    def rest(self) -> None:
        """No frame follows for a while: what happens meanwhile is not part of any."""
        self._last = None
        self._now = dict.fromkeys(STAGES, 0.0)

    def recent(self, stages) -> float:
        """Median seconds that these stages took together in the last few frames."""
        return float(np.median(np.sum([list(self._stages[s])[-RECENT:] for s in stages], axis=0)))

    def frame_seconds(self) -> float:
        """Mean length of the last frames."""
        return float(np.mean(self.frames))

    def medians(self) -> dict[str, float]:
        """Median seconds per stage over the last frames."""
        return {name: float(np.median(values)) for name, values in self._stages.items()}
