"""Find the pieces of a tangled ray in its next window.

A window (windows.py) is a section of the ray; the pieces are of all tets that the ray crosses
there.

Shapes: T tets, S slots.
"""

import warp as wp

from ...field import is_occupied, subtet_of
from ..rays.marching import Samples
from ..rays.pose import Geometry
from ..rays.traversal import interval_in_tet, speed_and_fade

MOST_PIECES = wp.constant(1.0e6)  # passed at once: int() takes no larger numbers
SHORTEST = wp.constant(1.0e-6)  # window, of t, or of the unit of space if that is more
OUTSIDE = wp.constant(-2)  # as a ray's tet: it has left the mesh for good
FAR = wp.constant(1.0e30)
ROUNDING = wp.constant(2.4e-7)  # of t, or of the unit of space if that is more
NEAR = wp.constant(16.0)  # up to this t rounding is less than QUERY_GAP

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.func
def first_piece(start: float, t_in: float, speed: float, step: float):
    """A piece of a tet, such that those before it end at `start` or before."""
    return int(wp.clamp((start - t_in) * speed / step - 1.0, 0.0, MOST_PIECES))


@wp.func
def next_piece(
    piece: int,
    piece_count: int,
    mask: wp.uint64,  # of the tet
    alpha: wp.vec4,  # to t_in: what interval_in_tet says
    slope: wp.vec4,
    near: float,
    t_in: float,
    speed: float,
    rest_length: float,  # of the ray in the tet
    step: float,  # Δ
    start: float,
    end: float,
):
    """The next piece of a tet with an occupied middle that reaches into a window.

    Returns:
        The piece, where it begins in the window, where it ends, and the coordinates of its
        middle.  There is none if the first is `piece_count`, or the second not before `end`.
    """
    # By rounding, a piece that ends where the window begins may end a little behind it.
    earliest_end = start + ROUNDING * wp.max(start, 1.0)
    next = int(piece)
    begin = float(0.0)
    until = float(0.0)
    bary = wp.vec4()
    going = bool(next < piece_count)
    while going:
        low = float(next) * step
        high = wp.min(low + step, rest_length)
        begin = wp.max(t_in + low / speed, start)
        until = t_in + high / speed
        if begin >= end:
            going = False
        elif until > earliest_end:
            bary = alpha + (t_in + 0.5 * (low + high) / speed - near) * slope
            going = not is_occupied(mask, subtet_of(bary))
        if going:
            next += 1
            going = next < piece_count
    return next, begin, until, bary


@wp.func
def pieces_behind(
    geometry: Geometry, tet: int, slope: wp.vec4, t_in: float, t_out: float, start: float
):
    """Of a ray's interval in a tet: |F⁻¹d|, fade, length at rest, number of pieces, first piece.

    The first piece is the first one that ends behind `start`.
    """
    speed, fade = speed_and_fade(geometry, tet, slope)
    rest_length = (t_out - t_in) * speed
    piece_count = int(wp.ceil(rest_length / geometry.step))
    return speed, fade, rest_length, piece_count, first_piece(start, t_in, speed, geometry.step)


@wp.func
def first_pieces(
    geometry: Geometry,
    boxes: wp.uint64,  # id of the BVH of all tets
    origin: wp.vec3,
    direction: wp.vec3,
    start: float,
    limit: float,
    first_slot: int,
    stride: int,  # from one slot of the ray to the next
    most: int,  # slots of the ray
    samples: Samples,  # out: t is where a piece begins in the window, length is κ / σ
    highs: wp.array(dtype=float),  # [S] out: where it ends there
):
    """The pieces that a ray meets first behind `start`, as many as have room.

    Returns:
        How many they are, where the first one begins, and where their window ends: at `limit`,
        or where the first piece begins that has no room.  All pieces that overlap the window are
        there, in any order.
    """
    step = geometry.step
    count = int(0)
    end = float(limit)
    latest = int(0)  # slot of the piece that begins last, once all slots are taken
    passed_by = wp.where(start < NEAR, start, 0.0)
    query = wp.bvh_query_ray(boxes, origin + passed_by * direction, direction)
    tet = int(0)
    while wp.bvh_query_next(query, tet, end - passed_by):
        mask = geometry.occupancy[tet]
        if mask != wp.uint64(0) and geometry.shapes[2 * tet + 1][2] > 0.0:
            alpha, slope, near, t_in, t_out = interval_in_tet(geometry, tet, origin, direction)
            if t_out > t_in and t_out > start and t_in < end:
                speed, fade, rest_length, piece_count, piece = pieces_behind(
                    geometry, tet, slope, t_in, t_out, start
                )
                while piece < piece_count:
                    piece, begin, until, bary = next_piece(
                        piece,
                        piece_count,
                        mask,
                        alpha,
                        slope,
                        near,
                        t_in,
                        speed,
                        rest_length,
                        step,
                        start,
                        end,
                    )
                    if begin >= end:
                        piece = piece_count
                    elif piece < piece_count:
                        slot = first_slot + count * stride
                        if count == most:  # one of them has no room
                            slot = latest
                            end = wp.max(begin, samples.t[latest])
                        if begin < end or count < most:
                            samples.tet[slot] = tet
                            samples.bary[slot] = bary
                            samples.length[slot] = fade * speed
                            samples.t[slot] = begin
                            highs[slot] = until
                            count = wp.min(count + 1, most)
                            if count == most:
                                latest = first_slot
                                k = int(1)
                                while k < most:
                                    if samples.t[first_slot + k * stride] > samples.t[latest]:
                                        latest = first_slot + k * stride
                                    k += 1
                    piece += 1
    kept = int(0)
    first = float(end)
    n = int(0)
    while n < count:
        slot = first_slot + n * stride
        if samples.t[slot] < end:
            first = wp.min(first, samples.t[slot])
            target = first_slot + kept * stride
            highs[target] = wp.min(highs[slot], end)
            if n > kept:  # pieces that begin where the window ends left a gap
                samples.tet[target] = samples.tet[slot]
                samples.bary[target] = samples.bary[slot]
                samples.length[target] = samples.length[slot]
                samples.t[target] = samples.t[slot]
            kept += 1
        n += 1
    return kept, first, end


@wp.func
def interval_in_box(low: wp.vec3, high: wp.vec3, origin: wp.vec3, direction: wp.vec3):
    """Where a ray enters a box, at t >= 0, and where it leaves it; it misses it if that is less.

    A box beside a ray that is parallel to a side is not told from one that it meets.
    """
    t_in = float(0.0)
    t_out = float(1.0e30)
    for axis in range(3):
        if direction[axis] != 0.0:
            near = wp.where(direction[axis] > 0.0, low[axis], high[axis])
            far = wp.where(direction[axis] > 0.0, high[axis], low[axis])
            t_in = wp.max(t_in, (near - origin[axis]) / direction[axis])
            t_out = wp.min(t_out, (far - origin[axis]) / direction[axis])
    return t_in, t_out
