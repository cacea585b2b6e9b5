"""Rays on which tets overlap: all their pieces at once, merged (line 4 of the definition).

A BVH of all tets gives each ray every tet that it crosses; each tet is cut into pieces
from its own entry, as the walk does.  Pieces switch their media on at one end and off at
the other: with the ends sorted along the ray, running sums of κ and κ c are what lies
between two of them, however many tets overlap there.

    tau = Σ κ_k dt,  w = T (1 - exp(-tau)),  color = Σ κ_k c_k / Σ κ_k

The sums are float64: what was switched on has to vanish when it is switched off.

Shapes: R rays, M of them tangled, N pieces, 2 N ends.
"""

import numpy as np
import warp as wp

from ..field.occupancy import is_occupied, subtet_of
from .compositing import Pixels
from .marching import Rays, Samples, empty_samples
from .overlap import tet_boxes
from .traversal import Geometry, Pose, interval_in_tet, speed_and_fade

CPU_PIECES = 1 << 17  # at once, if no single ray has more
CUDA_PIECES = 1 << 20
DARK = wp.constant(wp.float64(1.0e-9))  # extinction that is only rounding, as in reference.py

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


class Layers:
    """Renders tangled rays in the present pose.

    `shade` is called as shade(samples, alive, counts, ends, count) -> sigma, rgb.
    """

    def __init__(self, pose: Pose, occupancy):
        self._pose, self._occupancy = pose, occupancy
        self._all = wp.array(np.arange(len(pose.tets), dtype=np.int32), device=pose.device)
        self._revision, self._boxes = -1, None

    def prepare(self) -> None:
        """Build the BVH of the present pose, unless it is there."""
        if self._revision != self._pose.revision:
            self._boxes = wp.Bvh(*tet_boxes(self._pose, self._all, len(self._all)))
            self._revision = self._pose.revision

    def render(self, rays: Rays, ids, step: float, pixels: Pixels, shade) -> int:
        """Fill the pixels of the rays `ids` [M]; the number of samples.

        Args:
            step: Δ, in rest length.
        """
        device, count = self._pose.device, len(ids)
        counts = wp.empty(count, dtype=int, device=device)
        inputs = [self._pose.geometry, self._occupancy, self._boxes.id, rays, ids, step]
        wp.launch(count_pieces_kernel, dim=count, inputs=inputs, outputs=[counts], device=device)
        ends = np.cumsum(counts.numpy(), dtype=np.int64)
        most, first = CUDA_PIECES if device.is_cuda else CPU_PIECES, 0
        while first < count:
            before = ends[first - 1] if first else 0
            last = max(first + 1, int(np.searchsorted(ends, before + most, side="right")))
            part = slice(first, last)
            self._render_part(
                inputs, ids[part], counts[part], int(ends[last - 1] - before), *(pixels, shade)
            )
            first = last
        return int(ends[-1])

    def _render_part(self, inputs, ids, counts, total, pixels, shade):
        device = self._pose.device
        ends = wp.empty(len(ids), dtype=int, device=device)
        wp.utils.array_scan(counts, ends, inclusive=True)
        samples = empty_samples(total, device)
        rates = wp.empty(total, dtype=float, device=device)
        # Sorting needs as much room again.
        places = wp.empty(4 * total, dtype=float, device=device)
        pieces = wp.empty(4 * total, dtype=int, device=device)
        starts_of_ends = wp.empty(len(ids), dtype=int, device=device)
        ends_of_ends = wp.empty(len(ids), dtype=int, device=device)
        wp.launch(
            write_pieces_kernel,
            dim=len(ids),
            inputs=[*inputs[:4], ids, inputs[5], counts, ends],
            outputs=[samples, rates, places, pieces, starts_of_ends, ends_of_ends],
            device=device,
        )
        sigma, rgb = shade(samples, ids, counts, ends, total)
        if total:
            wp.utils.segmented_sort_pairs(places, pieces, 2 * total, starts_of_ends, ends_of_ends)
        wp.launch(
            merge_kernel,
            dim=len(ids),
            inputs=[ids, counts, ends, sigma, rgb, rates, samples.tet, places, pieces],
            outputs=[pixels],
            device=device,
        )


@wp.func
def piece_count_of(length: float, step: float):
    return int(wp.ceil(length / step))


@wp.kernel
def count_pieces_kernel(
    geometry: Geometry,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    boxes: wp.uint64,  # id of the BVH of all tets
    rays: Rays,
    ids: wp.array(dtype=int),  # [M]
    step: float,  # Δ
    counts: wp.array(dtype=int),  # [M] out
):
    """How many pieces in occupied sub-tets each ray has."""
    i = wp.tid()
    ray = ids[i]
    origin = rays.origins[ray]
    direction = rays.directions[ray]
    count = int(0)
    query = wp.bvh_query_ray(boxes, origin, direction)
    tet = int(0)
    while wp.bvh_query_next(query, tet):
        mask = occupancy[tet]
        if mask != wp.uint64(0) and geometry.shapes[2 * tet + 1][2] > 0.0:
            alpha, slope, near, t_in, t_out = interval_in_tet(geometry, tet, origin, direction)
            if t_out > t_in:
                speed, _fade = speed_and_fade(geometry, tet, slope)
                rest_length = (t_out - t_in) * speed
                piece_count = piece_count_of(rest_length, step)
                piece = int(0)
                while piece < piece_count:
                    low = float(piece) * step
                    length = wp.min(step, rest_length - low)
                    middle = t_in + (low + 0.5 * length) / speed
                    if is_occupied(mask, subtet_of(alpha + (middle - near) * slope)):
                        count += 1
                    piece += 1
    counts[i] = count


@wp.kernel
def write_pieces_kernel(
    geometry: Geometry,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    boxes: wp.uint64,
    rays: Rays,
    ids: wp.array(dtype=int),  # [M]
    step: float,  # Δ
    counts: wp.array(dtype=int),  # [M]
    ends: wp.array(dtype=int),  # [M] inclusive scan of counts
    samples: Samples,  # out [N]
    rates: wp.array(dtype=float),  # [N] out: s |F^-1 d|, κ / σ
    places: wp.array(dtype=float),  # [4 N] out: t of the pieces' ends, in the first half
    pieces: wp.array(dtype=int),  # [4 N] out: 2 n for the beginning of piece n, 2 n + 1 its end
    starts_of_ends: wp.array(dtype=int),  # [M] out: where a ray's ends begin
    ends_of_ends: wp.array(dtype=int),  # [M] out
):
    """The same pieces again, in the same order, written."""
    i = wp.tid()
    ray = ids[i]
    origin = rays.origins[ray]
    direction = rays.directions[ray]
    n = ends[i] - counts[i]
    starts_of_ends[i] = 2 * n
    ends_of_ends[i] = 2 * ends[i]
    query = wp.bvh_query_ray(boxes, origin, direction)
    tet = int(0)
    while wp.bvh_query_next(query, tet):
        mask = occupancy[tet]
        if mask != wp.uint64(0) and geometry.shapes[2 * tet + 1][2] > 0.0:
            alpha, slope, near, t_in, t_out = interval_in_tet(geometry, tet, origin, direction)
            if t_out > t_in:
                speed, fade = speed_and_fade(geometry, tet, slope)
                rest_length = (t_out - t_in) * speed
                piece_count = piece_count_of(rest_length, step)
                piece = int(0)
                while piece < piece_count:
                    low = float(piece) * step
                    length = wp.min(step, rest_length - low)
                    middle = t_in + (low + 0.5 * length) / speed
                    bary = alpha + (middle - near) * slope
                    if is_occupied(mask, subtet_of(bary)):
                        samples.tet[n] = tet
                        samples.bary[n] = bary
                        samples.length[n] = fade * length
                        samples.t[n] = middle
                        rates[n] = fade * speed
                        places[2 * n] = t_in + low / speed
                        places[2 * n + 1] = t_in + (low + length) / speed
                        pieces[2 * n] = 2 * n
                        pieces[2 * n + 1] = 2 * n + 1
                        n += 1
                    piece += 1


@wp.kernel
def merge_kernel(
    ids: wp.array(dtype=int),  # [M]
    counts: wp.array(dtype=int),  # [M]
    ends: wp.array(dtype=int),  # [M]
    sigma: wp.array(dtype=float),  # [N]
    rgb: wp.array(dtype=wp.vec3),  # [N]
    rates: wp.array(dtype=float),  # [N]
    sample_tet: wp.array(dtype=int),  # [N]
    places: wp.array(dtype=float),  # [2 N] sorted within each ray
    pieces: wp.array(dtype=int),  # [2 N]
    pixels: Pixels,  # out
):
    i = wp.tid()
    ray = ids[i]
    e = 2 * (ends[i] - counts[i])
    last = 2 * ends[i]
    kappa = wp.float64(0.0)  # what is switched on
    emission = wp.vec3d()
    transmittance = wp.float64(1.0)
    color = wp.vec3d()
    depth = wp.float64(0.0)
    surface = int(-1)
    previous = float(0.0)
    while e < last:
        t = places[e]
        if kappa > DARK and t > previous:
            remaining = wp.exp(-kappa * wp.float64(t - previous))
            w = transmittance * (wp.float64(1.0) - remaining)
            color += (w / kappa) * emission
            depth += w * wp.float64(0.5 * (t + previous))
            transmittance *= remaining
        previous = t
        n = pieces[e] / 2
        sign = wp.float64(1 - 2 * (pieces[e] % 2))
        medium = sign * wp.float64(sigma[n]) * wp.float64(rates[n])
        c = rgb[n]
        kappa += medium
        emission += medium * wp.vec3d(wp.float64(c[0]), wp.float64(c[1]), wp.float64(c[2]))
        if surface < 0 and transmittance < wp.float64(0.5):
            surface = sample_tet[n]
        e += 1
    pixels.color[ray] = wp.vec3(float(color[0]), float(color[1]), float(color[2]))
    pixels.depth[ray] = float(depth)
    pixels.transmittance[ray] = float(transmittance)
    pixels.tet[ray] = surface
    pixels.sample_count[ray] = counts[i]
