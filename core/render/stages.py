"""How long the stages of rendering take, for whoever asks."""

import threading
import time
from contextlib import contextmanager

import warp as wp


class Stages:
    """Adds up seconds per stage: by events on CUDA, by the clock on a CPU.

    Attributes:
        seconds: A dict to add to, or None: nobody asks, and nothing is recorded.
    """

    def __init__(self, device):
        self._device = wp.get_device(device)
        self._lock = threading.Lock()
        self.ask(None)

    def ask(self, seconds: dict | None):
        """Add to this dict from now on."""
        self.seconds, self._recorded = seconds, []

    @contextmanager
    def __call__(self, name: str):
        """Time what happens within; on CUDA `collect` adds it up."""
        if self.seconds is None:
            yield
            return
        if self._device.is_cuda:
            first, last = (wp.Event(self._device, enable_timing=True) for _ in range(2))
            stream = wp.get_stream(self._device)
            stream.record_event(first)
            yield
            stream.record_event(last)
            self._recorded.append((name, first, last))
            return
        start = time.perf_counter()
        yield
        self._add(name, time.perf_counter() - start)

    def collect(self):
        """Wait for what was recorded, and add it."""
        if not self._recorded:
            return
        wp.synchronize_device(self._device)
        for name, first, last in self._recorded:
            self._add(name, 1e-3 * wp.get_event_elapsed_time(first, last))
        self._recorded.clear()

    def _add(self, name, seconds):
        with self._lock:  # tiles of an image run in threads
            self.seconds[name] = self.seconds.get(name, 0.0) + seconds
