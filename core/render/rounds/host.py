"""Rounds that the host waits for: on the CPU, and on CUDA where the wavefront does not apply.

Each round gives every ray that is left at most K samples:

    march        rays to slots [R, K], then packed without gaps
    shade        samples to density and color (shading.py)
    accumulate   samples to pixels, and the list of rays that are left

Shapes: R rays, K slots per ray, N packed samples.
"""

import warp as wp

from ..rays import (
    FILL_SLOTS,
    MIDDLE,
    Pose,
    Rays,
    RaySamples,
    empty_samples,
    march_kernel,
    pack_kernel,
)
from .compositing import Pixels, accumulate_kernel

ROUND_SLOTS = (4, 4, 4, 4, 8, 8, 16, 32, 64, 128)  # K by round: most rays end after 12 samples

wp.set_module_options({"enable_backward": False})


class HostRounds:
    """Renders rays that are not tangled in the present pose."""

    def __init__(self, pose: Pose, occupancy, shading, march_step: float):
        self._pose, self._occupancy = pose, occupancy
        self._shading, self._march_step = shading, march_step
        self._middle = wp.full(1, MIDDLE, dtype=int, device=pose.device)

    def render(self, rays: Rays, alive, pixels: Pixels, options, stage) -> int:
        """Add the rays `alive` to the pixels, to their ends; returns the number of samples."""
        sample_count, round_, device = 0, 0, self._pose.device
        while len(alive):
            slot_count = ROUND_SLOTS[min(round_, len(ROUND_SLOTS) - 1)]
            with stage("march"):
                found = self.march(rays, alive, slot_count, options)
            sigma, rgb = self._shading.shade(rays, found, options, stage)
            with stage("accumulate"):
                still_alive = wp.empty(len(alive), dtype=int, device=device)
                still_alive_count = wp.zeros(1, dtype=int, device=device)
                closing = int(not options.conformance)
                inputs = [sigma, rgb, found, rays.tet, options.stop, closing, pixels]
                outputs = [still_alive, still_alive_count]
                wp.launch(accumulate_kernel, len(alive), inputs, outputs, device=device)
                alive = still_alive[: int(still_alive_count.numpy()[0])]
            sample_count += len(sigma)
            round_ += 1
        return sample_count

    def march(self, rays, alive, slot_count, options) -> RaySamples:
        """One round's samples of the rays `alive`."""
        pose, count, device = self._pose, len(alive), self._pose.device
        slots = empty_samples(count * slot_count, device)
        found = RaySamples()
        found.ids = alive
        found.counts = wp.empty(count, dtype=int, device=device)
        found.ends = wp.empty(count, dtype=int, device=device)
        step = self._march_step * options.step_factor
        inputs = [pose.geometry, self._occupancy, rays, alive, step, slot_count]
        inputs += [self._middle, FILL_SLOTS, found.ends]
        wp.launch(march_kernel, count, inputs, [slots, found.counts], device=device)
        wp.utils.array_scan(found.counts, found.ends, inclusive=True)
        found.samples = empty_samples(int(found.ends[count - 1 : count].numpy()[0]), device)
        wp.launch(pack_kernel, count, [slots, slot_count], [found], device=device)
        return found
