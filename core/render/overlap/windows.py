"""Render tangled rays on a CPU from front to back, one window (an interval of t) after another.

Inside a fold a ray crosses hundreds of pieces, but only the first few are visible.  A window
contains all pieces that overlap it, of all tets, so to render it only the transmittance in front
of it is needed from other windows.  Windows are as long as SLOTS pieces allow.  The ray ends in the
window in which its transmittance falls below the limit `stop`.  If even the shortest window
has too many pieces, the ray is *crowded*, and merging.py renders it.

Shapes: R rays, M of them tangled, K slots per ray, T tets.
"""

import numpy as np
import warp as wp

from ..rays.marching import Rays, Round, empty_round
from ..rays.pose import Geometry, Pose
from ..rounds.compositing import Pixels, ray_sums
from ..rounds.cpu import NativeShading, shade_native, trace_kernel
from .pieces import FAR, OUTSIDE, SHORTEST, first_pieces, interval_in_box

SLOTS = wp.constant(64)  # K
FEW = wp.constant(24)  # pieces after which the next window is longer
AT_ONCE = 256  # rays: their samples stay in a core's cache
FIRST_STEPS = 6.0  # length of the first window [Δ]
GROWTH = wp.constant(2.0)
SHORTER = wp.constant(0.7)
CROWDED = wp.constant(-1.0)  # as a window's length


# It is compiled with the kernel of other rays, since both contain the same native shading.
@wp.kernel(enable_backward=False, module=trace_kernel.module)
def trace_windows_kernel(
    geometry: Geometry,
    boxes: wp.uint64,  # id of the BVH of all tets
    box_low: wp.vec3,  # of all vertices
    box_high: wp.vec3,
    rays: Rays,
    lengths: wp.array(dtype=float),  # [R] in: of the first window; out: CROWDED, or not
    round: Round,  # in: all tangled rays, and slots; out: those that are left
    shading: NativeShading,
    pixels: Pixels,
    totals: wp.array(dtype=int),  # [2] out: rays that are left, samples
):
    """All windows of the rays of a list, by one thread."""
    count = round.alive.shape[0]
    sample_count = int(0)
    i = int(0)
    while i < count:  # another path may have had them before
        ray = round.alive[i]
        rays.t[ray] = 0.0
        pixels.color[ray] = wp.vec3()
        if pixels.sums.shape[0] > 0:
            pixels.sums[ray] = ray_sums()
        pixels.depth[ray] = 0.0
        pixels.transmittance[ray] = 1.0
        pixels.tet[ray] = -1
        pixels.sample_count[ray] = 0
        i += 1
    while count > 0:
        left = int(0)
        round.first = 0
        while round.first < count:
            round.ray_count = wp.min(round.counts.shape[0], count - round.first)
            i = int(0)
            while i < round.ray_count:
                ray = round.alive[round.first + i]
                origin = rays.origins[ray]
                direction = rays.directions[ray]
                start = float(rays.t[ray])
                length = lengths[ray]
                _in, last = interval_in_box(box_low, box_high, origin, direction)
                end = float(start)
                found = int(0)
                crowded = bool(False)
                while found == 0 and end < last and not crowded:
                    start = end
                    limit = wp.min(start + length, last)
                    found, front, end = first_pieces(
                        geometry,
                        boxes,
                        origin,
                        direction,
                        start,
                        limit,
                        i * SLOTS,
                        1,
                        SLOTS,
                        round.samples,
                        round.highs,
                    )
                    crowded = end < limit and end - start < SHORTEST * wp.max(start, 1.0)
                    if found == 0:
                        length = FAR  # to the other side of a gap
                    elif found == SLOTS:
                        length = wp.max(SHORTER * (end - front), geometry.step)
                    elif found < FEW:
                        length *= GROWTH
                if crowded:
                    length = CROWDED
                    found = 0
                    end = last
                lengths[ray] = length
                rays.t[ray] = end
                rays.tet[ray] = wp.where(end < last, 0, OUTSIDE)
                round.counts[i] = found
                sample_count += found
                i += 1
            shade_native(rays, round, shading, pixels, left, totals)
            left = totals[0]
            round.first += round.ray_count
        count = left
    totals[1] = sample_count


class WindowRounds:
    """Renders tangled rays on the CPU, in any number of threads at once."""

    def __init__(self, pose: Pose, shading):
        self._pose, self._shader = pose, shading.on_cpu

    def render(self, boxes, rays: Rays, ids, pixels: Pixels, options):
        """Fill the pixels of the rays `ids` [M].

        Args:
            boxes: The BVH of all tets in the present pose.

        Returns:
            The crowded rays, whose pixels are untouched or unfinished, and the number of samples.
        """
        vertices = self._pose.vertices.numpy()
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        if not np.isfinite([low, high]).all():
            return ids, 0
        geometry, ray_count = self._pose.geometry, min(AT_ONCE, len(ids))
        capacity = ray_count * SLOTS
        round = empty_round(wp.clone(ids), ray_count, capacity)
        round.highs = wp.empty(capacity, dtype=float, device="cpu")
        length = FIRST_STEPS * geometry.step
        lengths = wp.full(len(rays.t), length, dtype=float, device="cpu")
        totals = wp.zeros(2, dtype=int, device="cpu")
        inputs = [geometry, boxes.id, wp.vec3(*low), wp.vec3(*high), rays, lengths, round]
        inputs += [self._shader.of_launch(options), pixels]
        wp.launch(trace_windows_kernel, 1, inputs, [totals], device="cpu")
        chosen = ids.numpy()
        crowded = chosen[lengths.numpy()[chosen] < 0.0]
        return wp.array(crowded, dtype=int, device="cpu"), int(totals.numpy()[1])
