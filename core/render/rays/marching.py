"""Quadrature: the pieces of a ray that may have density.

The ray's interval in each tet is cut into pieces of rest length Δ, beginning at the ray's entry
into that tet; the last piece is shorter.  A piece counts if its middle lies in an occupied sub-tet.
The sample of a piece is at its middle; in training, at a random place within it.

A round of marching gives each ray at most K pieces.  A ray that is not finished keeps its
state and goes on in the next round.  The samples are written to arrays in one of three ways:

    slots [R, K], then pack_kernel removes the gaps    rounds that the host waits for; K is small
    slots without packing                              the wavefront on CUDA; in tracing.py a
                                                       few of each thread, again and again
    count, then march again and write                  training/run/batch.py: one round with a
                                                       large K; slots would take a gigabyte

Shapes: R rays, K slots per ray, N packed samples.
"""

import warp as wp

from ...base.wide import store_wide
from ...field import SUBTET_COUNT, basis_of, basis_vector, is_occupied, subtet_ahead
from .entries import Entries, next_entry
from .pose import Geometry
from .traversal import (
    MAX_TETS,
    SMALLEST_ADVANCE,
    entry_of,
    exit_tet,
    line_in_tet,
    link_across,
    speed_and_fade,
)

FILL_SLOTS = wp.constant(0)  # purposes of a round
COUNT = wp.constant(1)
WRITE = wp.constant(2)
MIDDLE = wp.constant(0)  # as a seed: evaluate at the middle
MOST_PIECES = wp.constant(1.0e6)  # at once: int() takes no larger numbers
ANY_DEPTH = wp.constant(1.0e30)  # as a ray's depth_left: nothing is expected
FEWEST_AT_ONCE = wp.constant(2.0)  # samples of a sub-tet, however dense it is expected to be

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.struct
class Rays:
    """Rays and how far each has come."""

    origins: wp.array(dtype=wp.vec3)  # [R]
    directions: wp.array(dtype=wp.vec3)  # [R] unit
    t: wp.array(dtype=float)  # [R] entry of the tet
    tet: wp.array(dtype=int)  # [R] -1: outside the mesh, -2: finished
    entry_face: wp.array(dtype=int)  # [R] of the tet, -1 if it came through the boundary
    piece: wp.array(dtype=int)  # [R] the tet's pieces already done
    entries: Entries  # [R]
    first: int  # number of ray 0; the number of a ray seeds its jitter


@wp.struct
class Samples:
    """Pieces that can hold density, in slots [R, K] or packed [N]."""

    tet: wp.array(dtype=int)
    bary: wp.array(dtype=wp.vec4)
    length: wp.array(dtype=float)  # s_k times the piece's rest length: optical depth / σ
    t: wp.array(dtype=float)  # of the piece's middle


@wp.struct
class Round:
    """Some rays of a list, and slots for their samples, on a CPU."""

    alive: wp.array(dtype=int)  # the list: numbers of rays
    first: int  # of them
    ray_count: int
    slot_count: int  # K
    samples: Samples  # [ray_count · K]
    highs: wp.array(dtype=float)  # likewise, where samples end that overlap; else empty
    counts: wp.array(dtype=int)  # [ray_count] samples of each ray


@wp.struct
class RaySamples:
    """Packed samples of some rays: those of ray ids[i] are ends[i] - counts[i] .. ends[i] - 1."""

    ids: wp.array(dtype=int)
    counts: wp.array(dtype=int)
    ends: wp.array(dtype=int)  # inclusive scan of the counts
    samples: Samples  # [N]


def empty_rays(count: int, device: wp.DeviceLike) -> Rays:
    rays = Rays()
    rays.origins = wp.empty(count, dtype=wp.vec3, device=device)
    rays.directions = wp.empty(count, dtype=wp.vec3, device=device)
    rays.t = wp.zeros(count, dtype=float, device=device)
    rays.tet = wp.full(count, -1, dtype=int, device=device)
    rays.entry_face = wp.full(count, -1, dtype=int, device=device)
    rays.piece = wp.zeros(count, dtype=int, device=device)
    return rays


def empty_samples(count: int, device: wp.DeviceLike) -> Samples:
    samples = Samples()
    samples.tet = wp.empty(count, dtype=int, device=device)
    samples.bary = wp.empty(count, dtype=wp.vec4, device=device)
    samples.length = wp.empty(count, dtype=float, device=device)
    samples.t = wp.empty(count, dtype=float, device=device)
    return samples


def empty_round(alive, ray_count: int, capacity: int) -> Round:
    """A round of at most `ray_count` rays of a list, with `capacity` slots for all of them."""
    round = Round()
    round.alive, round.ray_count, round.slot_count = alive, ray_count, capacity // max(ray_count, 1)
    round.samples = empty_samples(capacity, "cpu")
    round.counts = wp.empty(ray_count, dtype=int, device="cpu")
    return round


@wp.func
def march_ray(
    geometry: Geometry,
    rays: Rays,
    ray: int,
    samples: Samples,  # out
    first_slot: int,
    slot_spacing: int,  # from one slot of this ray to the next
    limit: int,  # slots
    seed: int = MIDDLE,  # or the seed of the jitter
    purpose: int = FILL_SLOTS,  # COUNT, or WRITE
    depth_left: float = ANY_DEPTH,  # expected optical depth after which a round has samples enough
    searches: bool = True,  # see next_entry
):
    """One round of one ray; returns the number of its samples.

    FILL_SLOTS stores how far the ray has come; COUNT and WRITE do not.  A ray that is expected to
    be opaque ends its round before `limit`: samples behind that are seldom evaluated for nothing.
    """
    step = geometry.step
    origin = rays.origins[ray]
    direction = rays.directions[ray]
    t = rays.t[ray]
    tet = rays.tet[ray]
    entry_face = rays.entry_face[ray]
    piece = rays.piece[ray]
    random = wp.rand_init(seed, rays.first + ray)
    count = int(0)
    most = int(limit)
    depth = float(depth_left)
    tets_left = int(MAX_TETS)
    while tet > -2 and count < most:
        # Two loops, so that on CUDA a warp's rays search together and then walk together.
        if tet == -1:
            found, entry_t = next_entry(geometry, rays.entries, ray, origin, direction, t, searches)
            t = entry_t
            entry_face = -1
            piece = 0
            tet = wp.where(found < 0, -2, found)
        while tet >= 0 and count < most:
            # No branch before the sub-tets: all that is read of a tet is asked for at once.
            alpha, slope = line_in_tet(geometry, tet, origin, t, direction)
            speed, fade = speed_and_fade(geometry, tet, slope)
            face, distance = exit_tet(alpha, slope, entry_face)
            stuck = tets_left <= 0 or face < 0  # it walks in circles, or in a flat tet
            link = link_across(geometry, tet, face)
            mask = geometry.occupancy[tet]
            entry = entry_of(alpha, slope, t)
            rest_length = wp.max(distance - entry, 0.0) * speed
            piece_count = int(wp.ceil(rest_length / step))
            if mask == wp.uint64(0) or fade <= 0.0 or stuck:
                piece_count = 0
            while piece < piece_count and count < most:
                length = wp.min(step, rest_length - float(piece) * step)
                at = entry + (float(piece) * step + 0.5 * length) / speed
                last = piece + 1
                if seed != MIDDLE:
                    at = entry + (float(piece) * step + wp.randf(random) * length) / speed
                subtet, ahead = subtet_ahead(alpha + at * slope, slope)
                if seed == MIDDLE:  # further middles are in the same sub-tet
                    last += int(wp.clamp(ahead * speed / step, 0.0, MOST_PIECES))
                last = wp.min(last, piece_count)
                if is_occupied(mask, subtet):
                    room = most - count
                    expected = float(0.0)  # extinction per rest length
                    if depth_left < ANY_DEPTH:
                        expected = fade * geometry.densities[wp.static(SUBTET_COUNT) * tet + subtet]
                        enough = wp.max(depth, 0.0) / wp.max(expected * step, 1.0e-9)
                        enough = wp.max(wp.min(enough, MOST_PIECES) + 1.0, FEWEST_AT_ONCE)
                        room = wp.min(room, int(enough))
                    last = wp.min(last, piece + room)
                    while piece < last:
                        length = wp.min(step, rest_length - float(piece) * step)
                        middle = entry + (float(piece) * step + 0.5 * length) / speed
                        if seed == MIDDLE:
                            at = middle
                        if purpose != COUNT:
                            slot = first_slot + count * slot_spacing
                            samples.tet[slot] = tet
                            store_wide(samples.bary, slot, alpha + at * slope)
                            samples.length[slot] = fade * length
                            samples.t[slot] = t + middle
                        depth -= expected * length
                        count += 1
                        piece += 1
                    if depth <= 0.0:
                        most = count
                piece = last
            if piece >= piece_count:
                t += wp.max(distance, SMALLEST_ADVANCE * wp.max(t, 1.0))
                piece = 0
                tets_left -= 1
                tet = wp.where(stuck, -2, wp.where(link >= 0, link / 4, -1))
                entry_face = link % 4
    if purpose == FILL_SLOTS:
        rays.t[ray] = t
        rays.tet[ray] = tet
        rays.entry_face[ray] = entry_face
        rays.piece[ray] = piece
    return count


@wp.kernel
def march_kernel(
    geometry: Geometry,
    rays: Rays,
    alive: wp.array(dtype=int),  # [threads] ray of each thread
    slot_count: int,  # K
    seed: int,  # MIDDLE, or the seed of the jitter
    samples: Samples,  # [threads · K] out
    counts: wp.array(dtype=int),  # [threads] out: samples of each ray
):
    """One round for each ray."""
    i = wp.tid()
    counts[i] = march_ray(
        geometry, rays, alive[i], samples, i * slot_count, 1, slot_count, seed=seed
    )


@wp.kernel
def pack_kernel(
    slots: Samples,  # [threads · K]
    slot_count: int,
    found: RaySamples,  # its samples are out
):
    i = wp.tid()
    source = i * slot_count
    target = found.ends[i] - found.counts[i]
    while target < found.ends[i]:
        found.samples.tet[target] = slots.tet[source]
        found.samples.bary[target] = slots.bary[source]
        found.samples.length[target] = slots.length[source]
        found.samples.t[target] = slots.t[source]
        source += 1
        target += 1


@wp.kernel
def basis_kernel(
    rays: Rays,
    rotations: wp.array(dtype=wp.mat33),  # [T] Q
    found: RaySamples,
    basis: wp.array(dtype=basis_vector),  # [N] out
):
    """Spherical harmonics of each packed sample's rest direction, Qᵀd."""
    i = wp.tid()
    direction = rays.directions[found.ids[i]]
    n = found.ends[i] - found.counts[i]
    while n < found.ends[i]:
        basis[n] = basis_of(wp.transpose(rotations[found.samples.tet[n]]) * direction)
        n += 1
