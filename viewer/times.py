"""Times of frames and their stages, for the read-outs and the choice of resolution.

All read-outs are means over the same frames, those of the last second, so that they follow what
the user does, and stages add up to their frame.
"""

import time
from collections import deque
from contextlib import contextmanager

import numpy as np

from ..core.deform import TIME_STEP

TASKS = ("simulate", "render", "upload", "draw", "panel", "flip")  # of a frame
HISTORY = 120  # frames
RECENT = 9  # frames; few enough to follow what the user does
SHOWN_SECONDS = 1.0  # over which read-outs are means


class FrameTimes:
    """Seconds per frame and per task of a frame, over the last frames."""

    def __init__(self):
        self.frames = deque([0.0], maxlen=HISTORY)
        self.rendering: dict[str, float] = {}  # the renderer's stages in the last image
        self._recent = deque([dict.fromkeys(TASKS, 0.0)], maxlen=RECENT)  # seconds of tasks
        self._now = dict.fromkeys(TASKS, 0.0)
        self._last = None
        self._kept = deque(maxlen=HISTORY)  # when a frame ended, its seconds, and its tasks'
        self._steps = deque([0.0], maxlen=RECENT)  # seconds that a tick of frames in motion took
        self._paces = deque(maxlen=HISTORY)  # when, and seconds by the clock and of the object

    @contextmanager
    def task(self, name: str):
        """Add the time spent inside to one task of the present frame."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._now[name] += time.perf_counter() - start

    def spent(self, name: str) -> float:
        """Seconds of a task so far, in the present frame."""
        return self._now[name]

    def end_frame(self) -> None:
        """Close the present frame; it began when the one before was closed."""
        now = time.perf_counter()
        if self._last is not None:
            self.frames.append(now - self._last)
            self._kept.append((now, now - self._last, self._now))
        self._recent.append(self._now)
        self._last, self._now = now, dict.fromkeys(TASKS, 0.0)

    def rest(self) -> None:
        """No frame follows for a while: the time until the next one belongs to no frame."""
        self._last = None
        self._now = dict.fromkeys(TASKS, 0.0)

    def recent(self, tasks) -> float:
        """Median seconds that these tasks took together in the last few frames."""
        return float(np.median([sum(now[name] for name in tasks) for now in self._recent]))

    def frame_seconds(self) -> float:
        """Mean length of the frames of the last second; 0 before the second frame."""
        shown = self._shown(self._kept)
        return float(np.mean([seconds for _, seconds, _ in shown])) if shown else 0.0

    def means(self) -> dict[str, float]:
        """Mean seconds per task of the frames of the last second."""
        shown = self._shown(self._kept) or [(0.0, 0.0, dict.fromkeys(TASKS, 0.0))]
        return {name: sum(tasks[name] for _, _, tasks in shown) / len(shown) for name in TASKS}

    def passed(self, seconds: float, ticks: int) -> None:
        """Note the seconds that passed for the user, and the ticks for an object that moves."""
        self._paces.append((time.perf_counter(), seconds, ticks * TIME_STEP))
        if ticks:
            self._steps.append(self._now["simulate"] / ticks)

    def tick_seconds(self) -> float:
        """Median seconds that a tick of the object took when it moved last; 0 before."""
        return float(np.median(self._steps))

    def pace(self) -> float:
        """The object's time to the clock's while it moved in the last second; 1 if it did not."""
        now = time.perf_counter()
        shown = [pace for pace in self._paces if now - pace[0] < SHOWN_SECONDS]
        clock = sum(seconds for _, seconds, _ in shown)
        return sum(seconds for _, _, seconds in shown) / clock if clock > 0.0 else 1.0

    @staticmethod
    def _shown(kept):
        """Those of the last second of frames, at least one if there is any."""
        return [frame for frame in kept if kept[-1][0] - frame[0] < SHOWN_SECONDS]
