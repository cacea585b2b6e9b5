"""The walk of a ray from tet to tet across faces.

Within a tet the barycentric coordinates alpha(t) are linear, so a ray leaves the tet where the
first falling coordinate reaches zero.  pose.py computes the coordinates; entries.py finds
the start of a walk.

Shapes: T tets.
"""

import warp as wp

from ...base.wide import load_wide, load_wide_int
from .pose import Geometry

# Two units in the last place of t per face: a ray through an edge or a vertex, where rounding
# makes the tets around it disagree, is carried past it and does not circle.
SMALLEST_ADVANCE = wp.constant(2.4e-7)
# Roundings of t are smaller.  Where a face is almost parallel to the ray, its two tets disagree by
# more; there pieces begin at t, where those of the tet before have ended.
ENTRY_SLACK = wp.constant(5.0e-7)  # relative to t
FADED = wp.constant(1.0)  # a tet with a smaller fade s is so flat that it is not fully there
MAX_TETS = wp.constant(4096)  # of a ray in one march; a longer walk goes in circles

wp.set_module_options({"enable_backward": False, "max_unroll": 4})


@wp.func
def orientation(geometry: Geometry):
    """1, or -1 if most tets are mirrored: then the normals of the boundary point inward."""
    return wp.where(2 * geometry.mirrored_count[0] > geometry.links.shape[0], -1.0, 1.0)


@wp.func
def line_in_tet(geometry: Geometry, tet: int, origin: wp.vec3, t: float, d: wp.vec3):
    """Barycentric coordinates of origin + t d, and how they change along d.

    As exact as float32 has them: t d is not rounded before the offset from the tet's corner is
    taken (with a fused multiply-add), and the origin's offset keeps what it loses ("TwoDiff",
    Knuth 1969).  With the point rounded first, pieces of the ray were a ten-thousandth of their
    length from where they belong, and fell into other sub-tets that often.
    """
    row1 = load_wide(geometry.rows, 3 * tet)
    row2 = load_wide(geometry.rows, 3 * tet + 1)
    row3 = load_wide(geometry.rows, 3 * tet + 2)
    corner = wp.vec3(row1[3], row2[3], row3[3])
    apart = origin - corner
    back = apart - origin
    lost = (origin - (apart - back)) - (corner + back)
    q = (apart + t * d) + lost
    a1 = row1[0] * q[0] + row1[1] * q[1] + row1[2] * q[2]
    a2 = row2[0] * q[0] + row2[1] * q[1] + row2[2] * q[2]
    a3 = row3[0] * q[0] + row3[1] * q[1] + row3[2] * q[2]
    s1 = row1[0] * d[0] + row1[1] * d[1] + row1[2] * d[2]
    s2 = row2[0] * d[0] + row2[1] * d[1] + row2[2] * d[2]
    s3 = row3[0] * d[0] + row3[1] * d[1] + row3[2] * d[2]
    return wp.vec4(1.0 - a1 - a2 - a3, a1, a2, a3), wp.vec4(-s1 - s2 - s3, s1, s2, s3)


@wp.func
def speed_and_fade(geometry: Geometry, tet: int, slope: wp.vec4):
    """|F^-1 d|, from the coordinates' change along d, and the tet's fade s."""
    a = load_wide(geometry.shapes, 2 * tet)
    b = load_wide(geometry.shapes, 2 * tet + 1)
    x = slope[1]
    y = slope[2]
    z = slope[3]
    square = a[0] * x * x + a[1] * y * y + a[2] * z * z
    square += a[3] * x * y + b[0] * x * z + b[1] * y * z
    return wp.sqrt(wp.max(square, 0.0)), b[2]


@wp.func
def interval_in_tet(geometry: Geometry, tet: int, origin: wp.vec3, direction: wp.vec3):
    """The interval of a ray inside a single tet, without knowledge of its neighbors.

    Returns:
        The coordinates at t_near, where the ray is close to the tet, their slopes, t_near,
        t_in >= 0, and t_out; the ray is inside if t_out > t_in.
    """
    corner = wp.vec3(
        geometry.rows[3 * tet][3], geometry.rows[3 * tet + 1][3], geometry.rows[3 * tet + 2][3]
    )
    near = wp.dot(corner - origin, direction)
    alpha, slope = line_in_tet(geometry, tet, origin, near, direction)
    t_in = float(0.0)
    t_out = float(1.0e30)
    i = int(0)
    while i < 4:
        if slope[i] > 0.0:
            t_in = wp.max(t_in, near - alpha[i] / slope[i])
        elif slope[i] < 0.0:
            t_out = wp.min(t_out, near - alpha[i] / slope[i])
        elif alpha[i] < 0.0:
            t_out = -1.0
        i += 1
    return alpha, slope, near, t_in, t_out


@wp.func
def exit_tet(alpha: wp.vec4, slope: wp.vec4, entry_face: int):
    """The exit of a ray from a tet, as a distance from the point with coordinates alpha.

    Returns:
        The face, or -1 if no coordinate falls (a flat tet), and the distance (>= 0).
    """
    # Written out: a loop over i would put both vectors into memory.
    far = float(1.0e30)
    d0 = wp.where(slope[0] < 0.0 and entry_face != 0, -alpha[0] / slope[0], far)
    d1 = wp.where(slope[1] < 0.0 and entry_face != 1, -alpha[1] / slope[1], far)
    d2 = wp.where(slope[2] < 0.0 and entry_face != 2, -alpha[2] / slope[2], far)
    d3 = wp.where(slope[3] < 0.0 and entry_face != 3, -alpha[3] / slope[3], far)
    distance = wp.min(wp.min(d0, d1), wp.min(d2, d3))
    face = wp.where(d0 == distance, 0, wp.where(d1 == distance, 1, wp.where(d2 == distance, 2, 3)))
    return wp.where(distance < far, face, -1), wp.max(distance, 0.0)


@wp.func
def entry_of(alpha: wp.vec4, slope: wp.vec4, t: float):
    """Where the line enters the tet, as a distance from the point at t with coordinates alpha.

    A walk's t is within a rounding of there: 10⁻⁴ of a piece.  0 where it is not, because the ray
    begins in the tet.
    """
    behind = float(-1.0e30)
    d0 = wp.where(slope[0] > 0.0, -alpha[0] / slope[0], behind)
    d1 = wp.where(slope[1] > 0.0, -alpha[1] / slope[1], behind)
    d2 = wp.where(slope[2] > 0.0, -alpha[2] / slope[2], behind)
    d3 = wp.where(slope[3] > 0.0, -alpha[3] / slope[3], behind)
    distance = wp.max(wp.max(d0, d1), wp.max(d2, d3))
    return wp.where(wp.abs(distance) <= ENTRY_SLACK * wp.max(t, 1.0), distance, 0.0)


@wp.func
def link_across(geometry: Geometry, tet: int, face: int):
    """Across a face: 4 · tet + the face of that tet, or -1 outside."""
    link = load_wide_int(geometry.links, tet)
    return wp.where(
        face < 2, wp.where(face == 0, link[0], link[1]), wp.where(face == 2, link[2], link[3])
    )
