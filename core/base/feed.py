"""Copy arrays from the host to a device again and again, without a new allocation each time."""

import numpy as np
import warp as wp


class Feed:
    """The way from the host to an array on a device.

    Array.assign() makes a new array of the host's at each call, which takes longer than a copy
    of a few thousand numbers.
    """

    def __init__(self, array: wp.array):
        self._array = array
        self._memory, self._taken = array, None
        if array.device.is_cuda:
            self._memory = wp.empty_like(array, device="cpu", pinned=True)
            self._taken = wp.Event(array.device)  # the device has read it
        self._on_host = self._memory.numpy()

    def put(self, values) -> None:
        """Fill the array with numbers of its shape, in NumPy's form.

        Raises:
            ValueError: They have another shape.
        """
        if np.shape(values) != self._on_host.shape:
            raise ValueError(f"{np.shape(values)} is not the shape {self._on_host.shape}")
        if self._taken:
            wp.synchronize_event(self._taken)
        np.copyto(self._on_host, values, casting="same_kind")
        if self._taken:
            wp.copy(self._array, self._memory)
            wp.get_stream(self._array.device).record_event(self._taken)
