"""Rounds that the host waits for: on the CPU, and on CUDA where the wavefront does not apply.

Each round gives every ray that is left at most K samples:

    march        rays to slots [R, K], then packed without gaps
    shade        samples to density and color (shading.py)
    accumulate   samples to pixels, and the list of rays that are left

Shapes: R rays, K slots per ray, N packed samples.
"""

import warp as wp

from ..rays import FILL_SLOTS, MIDDLE, Pose, Rays, empty_samples, march_kernel, pack_kernel
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
        """Add to the pixels of the rays `alive` until each has left the mesh or is opaque.

        Returns:
            The number of samples.
        """
        sample_count, round_ = 0, 0
        while len(alive):
            slot_count = ROUND_SLOTS[min(round_, len(ROUND_SLOTS) - 1)]
            with stage("march"):
                samples, counts, ends, count = self.march(rays, alive, slot_count, options)
            sigma, rgb = self._shading.shade(
                rays, alive, counts, ends, samples, count, options, stage
            )
            with stage("accumulate"):
                still_alive = wp.empty(len(alive), dtype=int, device=self._pose.device)
                still_alive_count = wp.zeros(1, dtype=int, device=self._pose.device)
                self._launch(
                    accumulate_kernel,
                    len(alive),
                    [
                        sigma,
                        rgb,
                        samples,
                        alive,
                        counts,
                        ends,
                        rays.tet,
                        options.stop,
                        int(not options.conformance),
                        pixels,
                    ],
                    [still_alive, still_alive_count],
                )
                alive = still_alive[: int(still_alive_count.numpy()[0])]
            sample_count += count
            round_ += 1
        return sample_count

    def march(self, rays, alive, slot_count, options):
        """One round's samples, packed; each ray's count [R]; their inclusive scan [R]; N."""
        count, device = len(alive), self._pose.device
        slots = empty_samples(count * slot_count, device)
        counts = wp.empty(count, dtype=int, device=device)
        ends = wp.empty(count, dtype=int, device=device)
        self._launch(
            march_kernel,
            count,
            [
                self._pose.geometry,
                self._occupancy,
                rays,
                alive,
                self._march_step * options.step_factor,
                slot_count,
                self._middle,
                FILL_SLOTS,
                ends,
            ],
            [slots, counts],
        )
        wp.utils.array_scan(counts, ends, inclusive=True)
        packed_count = int(ends[count - 1 : count].numpy()[0])
        packed = empty_samples(packed_count, device)
        self._launch(pack_kernel, count, [slots, counts, ends, slot_count], [packed])
        return packed, counts, ends, packed_count

    def _launch(self, kernel, dim, inputs, outputs):
        wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self._pose.device)
