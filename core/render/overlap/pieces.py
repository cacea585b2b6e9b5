"""The pieces of all tets that a ray crosses between two places: what a window holds.

Shapes: T tets, S slots.
"""

import warp as wp

from ...field import is_occupied, subtet_of
from ..rays import Geometry, Samples, interval_in_tet, speed_and_fade

MOST_PIECES = wp.constant(1.0e6)  # passed at once: int() takes no larger numbers
NEAR = wp.constant(16.0)  # up to this t rounding is less than QUERY_GAP

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.func
def pieces_between(
    geometry: Geometry,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    boxes: wp.uint64,  # id of the BVH of all tets
    origin: wp.vec3,
    direction: wp.vec3,
    step: float,  # Δ
    start: float,
    end: float,
    first_slot: int,
    stride: int,  # from one slot of the ray to the next
    most: int,  # slots of the ray
    samples: Samples,  # out: t is where a piece begins in the window, length is κ / σ
    highs: wp.array(dtype=float),  # [S] out: where it ends there
):
    """The number of pieces that overlap a window; with more than `most` it is most + 1."""
    count = int(0)
    passed_by = wp.where(start < NEAR, start, 0.0)
    query = wp.bvh_query_ray(boxes, origin + passed_by * direction, direction)
    tet = int(0)
    while count <= most and wp.bvh_query_next(query, tet, end - passed_by):
        mask = occupancy[tet]
        if mask != wp.uint64(0) and geometry.shapes[2 * tet + 1][2] > 0.0:
            alpha, slope, near, t_in, t_out = interval_in_tet(geometry, tet, origin, direction)
            if t_out > t_in and t_out > start and t_in < end:
                speed, fade = speed_and_fade(geometry, tet, slope)
                rest_length = (t_out - t_in) * speed
                piece_count = int(wp.ceil(rest_length / step))
                passed = wp.clamp((start - t_in) * speed / step - 1.0, 0.0, MOST_PIECES)
                piece = int(passed)
                while piece < piece_count and count <= most:
                    low = float(piece) * step
                    high = wp.min(low + step, rest_length)
                    begin = t_in + low / speed
                    until = wp.min(t_in + high / speed, end)
                    if begin >= end:
                        piece = piece_count
                    elif until > start:
                        bary = alpha + (t_in + 0.5 * (low + high) / speed - near) * slope
                        if is_occupied(mask, subtet_of(bary)):
                            if count < most:
                                slot = first_slot + count * stride
                                samples.tet[slot] = tet
                                samples.bary[slot] = bary
                                samples.length[slot] = fade * speed
                                samples.t[slot] = wp.max(begin, start)
                                highs[slot] = until
                            count += 1
                    piece += 1
    return count


@wp.func
def first_tet_after(
    geometry: Geometry,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    boxes: wp.uint64,  # id of the BVH of all tets
    origin: wp.vec3,
    direction: wp.vec3,
    start: float,
    last: float,
):
    """Where a ray is in an occupied tet first: `start` or later, or `last` if in none before."""
    nearest = float(last)
    passed_by = wp.where(start < NEAR, start, 0.0)
    query = wp.bvh_query_ray(boxes, origin + passed_by * direction, direction)
    tet = int(0)
    while nearest > start and wp.bvh_query_next(query, tet, nearest - passed_by):
        if occupancy[tet] != wp.uint64(0) and geometry.shapes[2 * tet + 1][2] > 0.0:
            _alpha, _slope, _near, t_in, t_out = interval_in_tet(geometry, tet, origin, direction)
            if t_out > t_in and t_out > start:
                nearest = wp.min(nearest, wp.max(t_in, start))
    return nearest


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
