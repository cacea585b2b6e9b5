"""The progress bar of a training run: PSNR, samples per second, time left."""

import time
from math import isfinite

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from .history import psnr_of


class TrainingProgress:
    """One bar per stage, if it is to be `shown`; a context manager."""

    def __init__(self, shown=True):
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TextColumn("{task.fields[psnr]}"),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            disable=not shown,
        )

    def __enter__(self):
        self._bar.start()
        return self

    def __exit__(self, *_):
        self._bar.stop()

    def begin(self, title: str, step_count: int, done: int = 0):
        self._since = time.perf_counter()
        return self._bar.add_task(title, total=step_count, completed=done, psnr="", rate="")

    def say(self, sentence: str):
        """A line above the bar."""
        self._bar.console.print(sentence)

    def advance(self, task, step_count: int, mse: float, sample_count: int):
        """Count steps; `mse` and `sample_count` are those of the last one."""
        now = time.perf_counter()
        rate = step_count * sample_count / max(now - self._since, 1e-9)
        self._since = now
        self._bar.update(
            task,
            advance=step_count,
            psnr=f"{psnr_of(mse):.2f} dB" if isfinite(mse) else "lost",
            rate=f"{rate / 1e6:.1f} M samples/s",
        )
