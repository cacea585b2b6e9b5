"""What a frame tells the host: how far vertices moved, and how much is tangled.

It is read when the next frame begins: on CUDA the frame is over by then, so that nothing
waits for the device.  Shapes: P parts.
"""

import warp as wp

from . import tangles
from .frame import CpuFrame, CudaFrame
from .tangles import TangleCounter


class Feedback:
    """Copies on their way to the host.

    Attributes:
        motion: The farthest that a vertex moved in this frame [m], in several parts of the
            mesh.  [MOST_THREADS] on the device
    """

    def __init__(self, tangles: TangleCounter, motion, device):
        self._device = device
        self._tangles = tangles
        self.motion = motion
        self._motion_on_host = wp.zeros_like(self.motion, device="cpu", pinned=device.is_cuda)
        self._counts_on_host = wp.zeros(
            tangles.counts.shape, dtype=int, device="cpu", pinned=device.is_cuda
        )
        self._copied = wp.Event(device) if device.is_cuda else None
        self._motion_is_coming = self._counts_are_coming = False

    def begin(self):
        """A frame begins."""
        self.motion.zero_()

    def end(self, vertices, count: bool, overlong: bool = False):
        """A frame is over; count tangles in its result if asked for (TangleCounter.count)."""
        wp.copy(self._motion_on_host, self.motion)
        self._motion_is_coming = True
        if count:
            self._tangles.count(vertices, overlong)
            wp.copy(self._counts_on_host, self._tangles.counts)
            self._counts_are_coming = True
        if self._copied is not None:
            self._device.stream.record_event(self._copied)

    def read(self):
        """Motion [m]; inverted tets and wrapped edges [2, P].  None for what has no news."""
        motion = counts = None
        if self._motion_is_coming and self._copied is not None:
            wp.synchronize_event(self._copied)
        if self._motion_is_coming:
            motion = float(self._motion_on_host.numpy().max())
        if self._counts_are_coming:
            counts = self._counts_on_host.numpy().copy()
        self.drop()
        return motion, counts

    def drop(self):
        """What is on its way is about a state that isn't any more."""
        self._motion_is_coming = self._counts_are_coming = False


def kernel_modules(device) -> list[str]:
    """Names of the Warp modules whose kernels a solver launches on a device.

    On CUDA a frame's main kernel, which depends on the mesh's size, is a module of its own
    that is not among them.
    """
    frame = CudaFrame if wp.get_device(device).is_cuda else CpuFrame
    return [tangles.__name__, frame.__module__]
