"""What a frame tells the host: how far vertices moved, and how many tets are inverted.

It is read when the next frame begins: on CUDA the frame is over by then, so that nothing
waits for the device.
"""

import warp as wp

from . import constraints
from .arrays import ConstraintList


class Feedback:
    """Copies on their way to the host.

    Attributes:
        motion: The farthest that a vertex moved in this frame [m].  [1] on the device
    """

    def __init__(self, device):
        self._device = device
        self.motion = wp.zeros(1, dtype=float, device=device)
        self._inverted = wp.zeros(1, dtype=int, device=device)
        self._motion_on_host = wp.zeros(1, dtype=float, device="cpu", pinned=device.is_cuda)
        self._inverted_on_host = wp.zeros(1, dtype=int, device="cpu", pinned=device.is_cuda)
        self._copied = wp.Event(device) if device.is_cuda else None
        self._motion_is_coming = self._count_is_coming = False

    def begin(self):
        """A frame begins."""
        self.motion.zero_()

    def end(self, vertices, tets: ConstraintList | None):
        """A frame is over; count the inverted ones of these tets, if any are given."""
        wp.copy(self._motion_on_host, self.motion)
        self._motion_is_coming = True
        if tets is not None:
            self._inverted.zero_()
            inputs = [vertices, tets.arrays.vertices, self._inverted]
            wp.launch(
                constraints.count_inverted_kernel, len(tets.in_use), inputs, device=self._device
            )
            wp.copy(self._inverted_on_host, self._inverted)
            self._count_is_coming = True
        if self._copied is not None:
            self._device.stream.record_event(self._copied)

    def read(self):
        """Motion [m] and number of inverted tets; None for what there is no news of."""
        motion = inverted_count = None
        if self._motion_is_coming and self._copied is not None:
            wp.synchronize_event(self._copied)
        if self._motion_is_coming:
            motion = float(self._motion_on_host.numpy()[0])
        if self._count_is_coming:
            inverted_count = int(self._inverted_on_host.numpy()[0])
        self.drop()
        return motion, inverted_count

    def drop(self):
        """What is on its way is about a state that isn't any more."""
        self._motion_is_coming = self._count_is_coming = False
