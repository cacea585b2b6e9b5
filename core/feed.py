"""Arrays on a device that the host fills again and again."""

import numpy as np
import warp as wp


class Feed:
    """The way from the host to an array on a device.

    Array.assign() makes a new array of the host's at each call, which takes longer than a copy
    of a few thousand numbers.
    """

    def __init__(self, array: wp.array):
        self._array = array
        self._room = array if array.device.is_cpu else wp.empty_like(array, device="cpu")
        self._on_host = self._room.numpy()

    def put(self, values) -> None:
        """Fill the array with numbers of its shape.

        CUDA has taken them from the host's memory, which isn't pinned, when this returns.
        """
        np.copyto(self._on_host, values, casting="same_kind")
        if self._room is not self._array:
            wp.copy(self._array, self._room)
