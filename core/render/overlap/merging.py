"""Render tangled rays by merging all pieces of all tets that a ray crosses (definition, line 4).

A BVH of all tets finds every tet that a ray crosses.  Each tet is cut into pieces from the ray's
entry into it, as in the walk.  A piece adds its medium at one end and removes it at the other.
The ends are sorted along the ray.  Between two ends the medium is the running sums of κ and κ c,
for any number of overlapping tets:

    tau = Σ κ_k dt,  w = T (1 - exp(-tau)),  color = Σ κ_k c_k / Σ κ_k

The sums are float64, so they return to zero when the last medium is removed.

Shapes: R rays, M of them tangled, N pieces, 2 N ends.
"""

from contextlib import nullcontext
from typing import Any

import numpy as np
import warp as wp

from ...field import is_occupied, subtet_of
from ..rays.marching import COUNT, WRITE, Rays, RaySamples
from ..rays.pose import Geometry, Pose, box_tree
from ..rays.traversal import interval_in_tet, speed_and_fade
from ..rounds.compositing import Pixels, ray_sums
from ..rounds.host import empty_found
from .windows import WindowRounds

CPU_PIECES = 1 << 17  # at once, if no single ray has more
CUDA_PIECES = 1 << 20
ray_sums_d = wp.types.vector(length=len(ray_sums()), dtype=wp.float64)
DARK = wp.constant(wp.float64(1.0e-9))  # a smaller extinction is rounding (definition/image.py)

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


class PieceMerger:
    """Renders tangled rays in the present pose."""

    def __init__(self, pose: Pose, shading):
        self._pose, self._shading = pose, shading
        self._revision, self._boxes = -1, None
        self._windows = WindowRounds(pose, shading) if pose.device.is_cpu else None

    def prepare(self) -> None:
        """Bring the BVH of all tets to the present pose.

        On CUDA it is built once and then fitted, which is less work for each pose.
        """
        if self._revision != self._pose.revision:
            old = self._boxes if self._pose.device.is_cuda else None
            self._boxes = box_tree(self._pose.vertices, self._pose.tets, old=old)
            self._revision = self._pose.revision

    def render(self, rays: Rays, ids, pixels: Pixels, options) -> int:
        """Fill the pixels of the rays `ids` [M]; returns the number of samples.

        `prepare` comes before.
        """
        shaded = 0
        if self._windows and len(ids):
            ids, shaded = self._windows.render(self._boxes, rays, ids, pixels, options)
        count = len(ids)
        if count == 0:
            return shaded
        device = self._pose.device
        counts = wp.empty(count, dtype=int, device=device)
        self._find_pieces(rays, ids, COUNT, counts, PieceList())
        ends = np.cumsum(counts.numpy(), dtype=np.int64)
        most, first = CUDA_PIECES if device.is_cuda else CPU_PIECES, 0
        while first < count:
            before = int(ends[first - 1]) if first else 0
            last = max(first + 1, int(np.searchsorted(ends, before + most, side="right")))
            some = slice(first, last)
            shaded += self._render_some(rays, ids[some], counts[some], pixels, options)
            first = last
        return shaded

    def _render_some(self, rays, ids, counts, pixels, options):
        device = self._pose.device
        pieces = empty_pieces(ids, counts)
        total = len(pieces.found.samples.tet)
        self._find_pieces(rays, ids, WRITE, counts, pieces)
        sigma, values = self._shading.shade(rays, pieces.found, options, stage=nullcontext)
        if device.is_cuda and total:
            first, last = pieces.first_switches, pieces.last_switches
            wp.utils.segmented_sort_pairs(pieces.places, pieces.switches, 2 * total, first, last)
        elif total:  # on a CPU that function takes 60 µs per ray
            wp.launch(sort_kernel, dim=len(ids), inputs=[pieces], device=device)
        sums = pixels.sums if len(pixels.sums) else pixels.color
        wp.launch(merge_kernel, len(ids), [pieces, sigma, values], [pixels, sums], device=device)
        self._shading.finish(ids, pixels, options)
        return total

    def _find_pieces(self, rays, ids, purpose, counts, pieces):
        pose, boxes = self._pose, self._boxes.id
        inputs = [pose.geometry, boxes, rays, ids, purpose, counts]
        wp.launch(pieces_kernel, len(ids), inputs, [pieces], device=pose.device)


@wp.struct
class PieceList:
    """Pieces of some rays, ray after ray."""

    found: RaySamples  # [M] rays, [N] pieces, whose length is s |F^-1 d|: κ / σ
    places: wp.array(dtype=float)  # [4 N] t of the ends; the second half is for the sort
    switches: wp.array(dtype=int)  # [4 N] 2 n where piece n begins, 2 n + 1 where it ends
    first_switches: wp.array(dtype=int)  # [M] index of each ray's first one
    last_switches: wp.array(dtype=int)  # [M] index behind each ray's last one


def empty_pieces(ids, counts) -> PieceList:
    pieces, ray_count, device = PieceList(), len(ids), ids.device
    pieces.found = empty_found(ids, counts)
    count = len(pieces.found.samples.tet)
    pieces.places = wp.empty(4 * count, dtype=float, device=device)
    pieces.switches = wp.empty(4 * count, dtype=int, device=device)
    pieces.first_switches = wp.empty(ray_count, dtype=int, device=device)
    pieces.last_switches = wp.empty(ray_count, dtype=int, device=device)
    return pieces


@wp.func
def write_piece(
    pieces: PieceList,
    n: int,
    tet: int,
    bary: wp.vec4,
    rate: float,
    low: float,
    high: float,
):
    samples = pieces.found.samples
    samples.tet[n] = tet
    samples.bary[n] = bary
    samples.length[n] = rate
    pieces.places[2 * n] = low
    pieces.places[2 * n + 1] = high
    pieces.switches[2 * n] = 2 * n
    pieces.switches[2 * n + 1] = 2 * n + 1


@wp.kernel
def pieces_kernel(
    geometry: Geometry,
    boxes: wp.uint64,  # id of the BVH of all tets
    rays: Rays,
    ids: wp.array(dtype=int),  # [M]
    purpose: int,  # COUNT or WRITE
    counts: wp.array(dtype=int),  # [M] COUNT: out, pieces in occupied sub-tets; WRITE: in
    pieces: PieceList,  # WRITE: out
):
    i = wp.tid()
    step = geometry.step
    ray = ids[i]
    origin = rays.origins[ray]
    direction = rays.directions[ray]
    first = int(0)
    limit = int(2147483647)
    if purpose == WRITE:
        limit = counts[i]
        first = pieces.found.ends[i] - limit
        pieces.first_switches[i] = 2 * first
        pieces.last_switches[i] = 2 * (first + limit)
    count = int(0)
    query = wp.bvh_query_ray(boxes, origin, direction)
    tet = int(0)
    while wp.bvh_query_next(query, tet):
        mask = geometry.occupancy[tet]
        if mask != wp.uint64(0) and geometry.shapes[2 * tet + 1][2] > 0.0:
            alpha, slope, near, t_in, t_out = interval_in_tet(geometry, tet, origin, direction)
            if t_out > t_in:
                speed, fade = speed_and_fade(geometry, tet, slope)
                rest_length = (t_out - t_in) * speed
                piece_count = int(wp.ceil(rest_length / step))
                piece = int(0)
                while piece < piece_count and count < limit:
                    low = float(piece) * step
                    high = wp.min(low + step, rest_length)
                    bary = alpha + (t_in + 0.5 * (low + high) / speed - near) * slope
                    if is_occupied(mask, subtet_of(bary)):
                        if purpose == WRITE:
                            write_piece(
                                pieces,
                                first + count,
                                tet,
                                bary,
                                fade * speed,
                                t_in + low / speed,
                                t_in + high / speed,
                            )
                        count += 1
                    piece += 1
    if purpose == COUNT:
        counts[i] = count
    else:  # if rounding found fewer pieces this time, empty ones take their places
        while count < limit:
            write_piece(pieces, first + count, 0, wp.vec4(1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
            count += 1


@wp.kernel
def sort_kernel(pieces: PieceList):
    """Sort each ray's switches by place, with Shell's sort: the tets are nearly in order."""
    i = wp.tid()
    first = pieces.first_switches[i]
    last = pieces.last_switches[i]
    gap = int(1)
    while gap < (last - first) / 9:
        gap = 3 * gap + 1
    while gap > 0:
        n = first + gap
        while n < last:
            place = pieces.places[n]
            switch = pieces.switches[n]
            m = int(n)
            while m >= first + gap and pieces.places[wp.max(m - gap, first)] > place:
                pieces.places[m] = pieces.places[m - gap]
                pieces.switches[m] = pieces.switches[m - gap]
                m -= gap
            pieces.places[m] = place
            pieces.switches[m] = switch
            n += 1
        gap /= 3


@wp.func
def double(v: wp.vec3):
    return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))


@wp.func
def double(v: ray_sums):  # noqa: F811
    w = ray_sums_d()
    k = int(0)
    while k < wp.static(len(ray_sums())):
        w[k] = wp.float64(v[k])
        k += 1
    return w


@wp.func
def single(v: wp.vec3d):
    return wp.vec3(float(v[0]), float(v[1]), float(v[2]))


@wp.func
def single(v: ray_sums_d):  # noqa: F811
    w = ray_sums()
    k = int(0)
    while k < wp.static(len(ray_sums())):
        w[k] = float(v[k])
        k += 1
    return w


@wp.kernel
def merge_kernel(
    pieces: PieceList,  # switches sorted within each ray
    sigma: wp.array(dtype=float),  # [N]
    values: wp.array(dtype=Any),  # [N] colors, or what rays sum instead
    pixels: Pixels,  # out; where tets overlap, `tet` is one of them
    sums: wp.array(dtype=Any),  # [R] out, of the values: the pixels' color, or their sums
):
    """Running sums along each ray: line 4 of the definition."""
    i = wp.tid()
    ray = pieces.found.ids[i]
    samples = pieces.found.samples
    e = pieces.first_switches[i]
    last = pieces.last_switches[i]
    kappa = wp.float64(0.0)  # of the media that are switched on
    emission = double(values.dtype())
    transmittance = wp.float64(1.0)
    total = double(values.dtype())
    depth = wp.float64(0.0)
    surface = int(-1)
    previous = float(0.0)
    while e < last:
        t = pieces.places[e]
        if kappa > DARK and t > previous:
            remaining = wp.exp(-kappa * wp.float64(t - previous))
            w = transmittance * (wp.float64(1.0) - remaining)
            total += (w / kappa) * emission
            depth += w * wp.float64(0.5 * (t + previous))
            transmittance *= remaining
        previous = t
        n = pieces.switches[e] / 2
        sign = wp.float64(1 - 2 * (pieces.switches[e] % 2))
        medium = sign * wp.float64(sigma[n]) * wp.float64(samples.length[n])
        kappa += medium
        emission += medium * double(values[n])
        if surface < 0 and transmittance < wp.float64(0.5):
            surface = samples.tet[n]
        e += 1
    sums[ray] = single(total)
    pixels.depth[ray] = float(depth)
    pixels.transmittance[ray] = float(transmittance)
    pixels.tet[ray] = surface
    pixels.sample_count[ray] = pieces.found.counts[i]


for _vector in (wp.vec3, ray_sums):
    wp.overload(merge_kernel, {name: wp.array(dtype=_vector) for name in ("values", "sums")})
