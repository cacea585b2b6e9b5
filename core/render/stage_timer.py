"""Measure the time of each stage of rendering, if a caller asks for it."""

import threading
import time
from contextlib import contextmanager

import warp as wp


class StageTimer:
    """Adds up seconds per stage: by events on CUDA, by the clock on a CPU.

    Attributes:
        seconds: The dict that times are added to; None records nothing.
    """

    def __init__(self, device):
        self._device = wp.get_device(device)
        self._lock = threading.Lock()
        self._events = []
        self.seconds: dict | None = None

    @contextmanager
    def __call__(self, name: str):
        """Time the block; on CUDA `collect` adds the time later."""
        seconds = self.seconds  # the caller may replace it before the block ends
        if seconds is None:
            yield
        elif self._device.is_cuda:
            first, last = (wp.Event(self._device, enable_timing=True) for _ in range(2))
            stream = wp.get_stream(self._device)
            stream.record_event(first)
            yield
            stream.record_event(last)
            self._events.append((seconds, name, first, last))
        else:
            start = time.perf_counter()
            try:
                yield
            finally:
                self._add(seconds, name, time.perf_counter() - start)

    def collect(self):
        """Wait for the recorded events; add their times to the dict that they were recorded for."""
        if not self._events:
            return
        wp.synchronize_device(self._device)
        for seconds, name, first, last in self._events:
            self._add(seconds, name, 1e-3 * wp.get_event_elapsed_time(first, last))
        self._events.clear()

    def _add(self, seconds, name, elapsed):
        with self._lock:  # tiles of an image run in threads
            seconds[name] = seconds.get(name, 0.0) + elapsed
