"""Rounds that the host waits for: on the CPU, and on CUDA where the wavefront does not apply.

Each round gives every ray that is left at most K samples:

    march        rays to slots [R, K]
    shade        packs the samples without gaps, then finds density and color (shading.py)
    accumulate   samples to pixels, and the list of rays that are left

On the CPU one launch does all rounds (cpu.py).  If stages are timed, each round is two launches:
the march (rays/cpu_march.py), then shading and the rest.

Shapes: R rays, K slots per ray, N packed samples.
"""

import numpy as np
import warp as wp

from ..rays.marching import MIDDLE, Rays, RaySamples, empty_samples, march_kernel, pack_kernel
from ..rays.pose import Pose
from .compositing import Pixels, accumulate_kernel
from .cpu import ROUND_SLOTS, CpuRounds

CUDA_ROUND_SLOTS = (8, 4, 8, 8, 16, 32, 64, 128)  # K by round: rays go on behind their ends
CPU_SLOTS = 1 << 19  # of a launch; 15 MB

wp.set_module_options({"enable_backward": False})


class HostRounds:
    """Renders rays that are not tangled in the present pose."""

    def __init__(self, pose: Pose, shading):
        self._pose, self._shading = pose, shading
        self._on_cpu = CpuRounds(pose, shading) if pose.device.is_cpu else None

    def render(self, rays: Rays, alive, pixels: Pixels, options, stage) -> int:
        """Add the rays `alive` to the pixels, to their ends; returns the number of samples."""
        if self._on_cpu and stage.seconds is None:
            return self._on_cpu.trace(rays, alive, pixels, options)
        sample_count, round_, all_rays = 0, 0, alive
        by_round = ROUND_SLOTS if self._on_cpu else CUDA_ROUND_SLOTS
        while len(alive):
            slot_count = by_round[min(round_, len(by_round) - 1)]
            left = []
            for some in self._some_at_a_time(alive, slot_count):
                with stage("march"):
                    slots, counts = self._march(rays, some, slot_count, pixels, options)
                still, count = self._shade(rays, some, slots, counts, pixels, options, stage)
                left.append(still)
                sample_count += count
            alive = left[0]
            if len(left) > 1:
                ids = np.concatenate([still.numpy() for still in left])
                alive = wp.array(ids, dtype=int, device="cpu")
            round_ += 1
        if not self._on_cpu:
            with stage("networks"):
                self._shading.finish(all_rays, pixels, options)
        return sample_count

    def for_tiles(self, memory, options):
        """What tiles on a CPU are traced with, in a TraceMemory; as CpuRounds'."""
        return self._on_cpu.for_tiles(memory, options)

    def _some_at_a_time(self, alive, slot_count):
        """Some of the rays at a time, on a CPU: their slots have to fit into memory."""
        count = len(alive)  # Warp takes no slice beyond the end
        most = CPU_SLOTS // slot_count if self._on_cpu else count
        return [alive[k : min(k + most, count)] for k in range(0, count, most)]

    def _march(self, rays, alive, slot_count, pixels, options):
        """One round's samples of the rays `alive` in slots, and how many each ray has."""
        if self._on_cpu:
            return self._on_cpu.march(rays, alive, slot_count, pixels, options)
        count, device = len(alive), self._pose.device
        slots = empty_samples(count * slot_count, device)
        counts = wp.empty(count, dtype=int, device=device)
        inputs = [self._pose.geometry, rays, alive, slot_count, MIDDLE]
        wp.launch(march_kernel, count, inputs, [slots, counts], device=device)
        return slots, counts

    def _shade(self, rays, alive, slots, counts, pixels, options, stage):
        """Add a round's samples to the pixels: the rays that are left, the number of samples."""
        if self._on_cpu:
            with stage("shade"):
                return self._on_cpu.shade(rays, alive, slots, counts, pixels, options)
        device, count = self._pose.device, len(alive)
        with stage("march"):
            found = packed(slots, counts, alive)
        sigma, values = self._shading.shade(rays, found, options, stage)
        with stage("accumulate"):
            still_alive = wp.empty(count, dtype=int, device=device)
            still_alive_count = wp.zeros(1, dtype=int, device=device)
            closing = int(not options.conformance)
            sums = pixels.sums if len(pixels.sums) else pixels.color
            inputs = [sigma, values, found, rays.tet, options.termination, closing, pixels, sums]
            outputs = [still_alive, still_alive_count]
            wp.launch(accumulate_kernel, count, inputs, outputs, device=device)
            return still_alive[: int(still_alive_count.numpy()[0])], len(sigma)


def packed(slots, counts, ids) -> RaySamples:
    """Samples of the rays `ids` from slots [R · K], without gaps."""
    found, count = empty_found(ids, counts), len(ids)
    wp.launch(pack_kernel, count, [slots, len(slots.tet) // count], [found], device=ids.device)
    return found


def empty_found(ids, counts) -> RaySamples:
    """Memory for as many samples of the rays `ids` as `counts` says; waits for the device."""
    found = RaySamples()
    found.ids, found.counts = ids, counts
    found.ends = wp.empty(len(ids), dtype=int, device=ids.device)
    wp.utils.array_scan(counts, found.ends, inclusive=True)
    found.samples = empty_samples(int(found.ends[len(ids) - 1 :].numpy()[0]), ids.device)
    return found
