"""The progress bar of a training run: PSNR, samples per second, time left."""

import time
from math import log10

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor

REFRESH_STEPS = 25  # reading the error back waits for the device, so not at every step


class TrainingProgress:
    """One bar per stage; a context manager."""

    def __init__(self):
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TextColumn("{task.fields[psnr]}"),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
        )

    def __enter__(self):
        self._bar.start()
        return self

    def __exit__(self, *_):
        self._bar.stop()

    def begin(self, title: str, step_count: int):
        self._errors, self._samples, self._steps = [], 0, 0
        self._since = time.perf_counter()
        return self._bar.add_task(title, total=step_count, psnr="", rate="")

    def advance(self, task, error: Tensor, sample_count: int):
        """Count one step with its mean squared error (left on the device)."""
        self._errors.append(error)
        self._samples += sample_count
        self._steps += 1
        if self._steps >= REFRESH_STEPS:
            self._show(task)

    def end(self, task):
        if self._steps:
            self._show(task)
        self._bar.stop_task(task)

    def _show(self, task):
        mse = float(sum(self._errors) / len(self._errors))
        now = time.perf_counter()
        rate = self._samples / max(now - self._since, 1e-9)
        self._bar.update(
            task,
            advance=self._steps,
            psnr=f"{-10.0 * log10(max(mse, 1e-12)):.2f} dB",
            rate=f"{rate / 1e6:.1f} M samples/s",
        )
        self._errors, self._samples, self._steps, self._since = [], 0, 0, now
