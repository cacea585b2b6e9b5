"""Results of a frame for the host: the vertices' motion, and counts of tangles.

The host reads it when the next frame begins.  On CUDA the frame has ended by then, so the
host doesn't wait for the device.  Shapes: P parts.
"""

import warp as wp

from .tangles import TangleCounter


class Feedback:
    """Copies of a frame's results on their way to the host."""

    def __init__(self, tangles: TangleCounter, motion):
        """Take the array that frames write their motion to (FrameArrays)."""
        self._tangles, self._device = tangles, motion.device
        self._sources = motion, tangles.counts
        self._copies = [
            wp.zeros_like(source, device="cpu", pinned=self._device.is_cuda)
            for source in self._sources
        ]
        self._expected = 0  # how many of them are on their way
        self._copied = wp.Event(self._device) if self._device.is_cuda else None

    def begin(self):
        """A frame begins."""
        self._sources[0].zero_()

    def end(self, vertices, count: bool, overlong: bool = False):
        """A frame ends; count tangles in its result if asked for (TangleCounter.count)."""
        if count:
            self._tangles.count(vertices, overlong)
        self._expected = 2 if count else 1
        for copy, source in zip(self._copies[: self._expected], self._sources, strict=False):
            wp.copy(copy, source)
        if self._copied is not None:
            self._device.stream.record_event(self._copied)

    def read(self):
        """Motion [m]; inverted tets and wrapped edges [2, P].  None for what isn't new."""
        if self._expected and self._copied is not None:
            wp.synchronize_event(self._copied)
        expected, self._expected = self._expected, 0
        motion, counts = (copy.numpy() for copy in self._copies)
        motion = float(motion.max()) if expected > 0 else None
        return motion, counts.copy() if expected > 1 else None

    def drop(self):
        """Forget copies that are on their way: the state that they are about has changed."""
        self._expected = 0
