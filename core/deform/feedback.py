"""What a frame reports to the host: how far vertices moved, and how much is tangled.

The host reads it when the next frame begins.  On CUDA the frame has ended by then, so the
host doesn't wait for the device.  Shapes: P parts.
"""

import warp as wp

from .tangles import TangleCounter


class HostCopy:
    """An array's way from a device to the host."""

    def __init__(self, array):
        self._array = array
        self._host = wp.zeros_like(array, device="cpu", pinned=array.device.is_cuda)
        self.expected = False

    def start(self):
        wp.copy(self._host, self._array)
        self.expected = True

    def take(self):
        """The copy, or None if none was started since."""
        expected, self.expected = self.expected, False
        return self._host.numpy().copy() if expected else None


class Feedback:
    """Copies of a frame's results on their way to the host."""

    def __init__(self, tangles: TangleCounter, motion):
        """Take the array that frames write their motion to (FrameArrays)."""
        self._tangles, self._motion = tangles, motion
        self._motion_copy, self._counts_copy = HostCopy(motion), HostCopy(tangles.counts)
        self._copied = wp.Event(motion.device) if motion.device.is_cuda else None

    def begin(self):
        """A frame begins."""
        self._motion.zero_()

    def end(self, vertices, count: bool, overlong: bool = False):
        """A frame ends; count tangles in its result if asked for (TangleCounter.count)."""
        self._motion_copy.start()
        if count:
            self._tangles.count(vertices, overlong)
            self._counts_copy.start()
        if self._copied is not None:
            self._motion.device.stream.record_event(self._copied)

    def read(self):
        """Motion [m]; inverted tets and wrapped edges [2, P].  None for what isn't new."""
        if self._motion_copy.expected and self._copied is not None:
            wp.synchronize_event(self._copied)
        motion, counts = self._motion_copy.take(), self._counts_copy.take()
        return None if motion is None else float(motion.max()), counts

    def drop(self):
        """Forget copies that are on their way: the state that they are about has changed."""
        self._motion_copy.expected = self._counts_copy.expected = False
