"""Record a fixed sequence of launches; on CUDA, it then runs as one launch."""

import warp as wp


class Recorded:
    """Calls a function whose launches, copies and arrays never change.

    The first call loads the kernels.  On CUDA the second one records a graph, and all others
    launch that: ten launches take the host a quarter of a millisecond, a graph takes a tenth
    of that.  The function is given at each call and not kept, since it is mostly a method of
    the owner, whose memory would be freed late.
    """

    def __init__(self, device):
        self._device = wp.get_device(device)
        self._is_loaded, self._graph = False, None
        # Scans and sorts need memory of their own, which only a pool gives to a graph.
        self._records = self._device.is_cuda and wp.is_mempool_enabled(self._device)

    def __call__(self, launch) -> None:
        if not (self._is_loaded and self._records):
            launch()
            self._is_loaded = True
            return
        if self._graph is None:
            with wp.ScopedCapture(self._device, force_module_load=False) as capture:
                launch()
            self._graph = capture.graph
        wp.capture_launch(self._graph)
