"""How long the stages of rendering take, for whoever asks."""

import threading
import time
from contextlib import contextmanager

import warp as wp


class Stages:
    """Adds up seconds per stage; each one then waits for the device, so the sum grows.

    Attributes:
        seconds: A dict to add to, or None: nobody asks, and nothing waits.
    """

    def __init__(self, device):
        self.seconds = None
        self._device = device
        self._lock = threading.Lock()

    @contextmanager
    def __call__(self, name: str):
        """Time what happens within."""
        if self.seconds is None:
            yield
            return
        start = time.perf_counter()
        try:
            yield
            wp.synchronize_device(self._device)
        finally:
            elapsed = time.perf_counter() - start
            with self._lock:  # tiles of an image run in threads
                self.seconds[name] = self.seconds.get(name, 0.0) + elapsed
