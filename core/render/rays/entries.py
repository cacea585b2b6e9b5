"""Find where a ray meets its first tet, and where it enters the mesh again.

`enter_mesh` searches the boundary for the first entry farther along the ray than t.  `find_entries`
finds all entries of a ray in one pass through a BVH of the boundary's faces.  On CUDA most rays use
`find_entries`: with a search for each entry, a warp takes as long as its ray with the most
searches. `enter_mesh` serves the rays that have more entries than a list holds, that meet an edge
of the boundary, or whose entries and exits do not pair up, as when they start inside.  It takes
many registers, so rounds/tracing.py and slot_march.py run most rays in a kernel without it: then a
GPU can run more rays at once.

Shapes: R rays, B boundary faces.
"""

import warp as wp

from .pose import QUERY_GAP, Geometry
from .traversal import (
    MAX_TETS,
    SMALLEST_ADVANCE,
    exit_tet,
    line_in_tet,
    link_across,
    orientation,
)

# A ray whose volume with an edge is below this, times its distance squared, may be on the edge's
# other side for a walk through the tets: rounding is 4e-8.  The walk would end there, and of a
# million pixels one would show what is behind the object.
EDGE_SLACK = wp.constant(1.0e-7)
MOST_ENTRIES = wp.constant(8)
UNKNOWN = wp.constant(-1)  # as the count of a ray: it uses enter_mesh

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.struct
class Entries:
    """Entries of each ray, nearest first; if the arrays are empty, all rays use enter_mesh."""

    t: wp.array2d(dtype=float)  # [MOST_ENTRIES, R]
    tet: wp.array2d(dtype=int)  # [MOST_ENTRIES, R]
    count: wp.array(dtype=int)  # [R]
    next: wp.array(dtype=int)  # [R] the one to use when the ray is outside


def empty_entries(count: int, device: wp.DeviceLike) -> Entries:
    entries = Entries()
    entries.t = wp.empty((MOST_ENTRIES, count), dtype=float, device=device)
    entries.tet = wp.empty((MOST_ENTRIES, count), dtype=int, device=device)
    entries.count = wp.empty(count, dtype=int, device=device)
    entries.next = wp.empty(count, dtype=int, device=device)
    return entries


@wp.func
def enter_mesh(geometry: Geometry, origin: wp.vec3, direction: wp.vec3, t: float):
    """The first tet that a ray meets at or behind t.

    If the next face is one that the ray leaves the mesh through, the ray started inside the
    mesh or slipped in at an edge.  Then a walk back from that face finds the tet at t.

    Returns:
        The tet, or -1 if there is none, and the t at which the ray is in it (>= t).
    """
    step = SMALLEST_ADVANCE * wp.max(t, 1.0)
    start = t - QUERY_GAP
    tet = int(-1)
    entry = float(t)
    searching = int(1)
    while searching == 1:
        query = wp.mesh_query_ray(geometry.boundary, origin + start * direction, direction, 1.0e6)
        searching = 0
        if query.result:
            hit = start + query.t
            if wp.dot(query.normal, direction) * orientation(geometry) < 0.0:
                tet = geometry.boundary_tets[query.face]
                entry = wp.max(t, hit)
            elif hit <= t + QUERY_GAP:  # the face that the ray has just left
                start = hit + step
                searching = 1
            else:
                tet, entry = walk_back(
                    geometry, origin, direction, t, geometry.boundary_tets[query.face], hit
                )
    return tet, entry


@wp.func
def walk_back(
    geometry: Geometry, origin: wp.vec3, direction: wp.vec3, t: float, last_tet: int, end: float
):
    """Walk back from a tet that a ray leaves at `end` to the tet at t or the entry."""
    tet = int(last_tet)
    position = float(end)
    exit_face = int(-1)
    tets_left = int(MAX_TETS)
    walking = int(1)
    while walking == 1:
        p = origin + position * direction
        alpha, slope = line_in_tet(geometry, tet, p, 0.0, -direction)
        face, distance = exit_tet(alpha, slope, exit_face)
        walking = 0
        previous = int(-1)
        if face >= 0:
            position -= wp.max(distance, SMALLEST_ADVANCE * wp.max(position, 1.0))
            previous = link_across(geometry, tet, face)
        if position > t and tets_left > 0 and previous >= 0:
            tet = previous / 4
            exit_face = previous % 4
            tets_left -= 1
            walking = 1
    return tet, wp.max(position, t)


@wp.func
def edge_volumes(geometry: Geometry, index: int, origin: wp.vec3, direction: wp.vec3):
    """Volumes of the tets that a ray spans with a boundary face's edges, times 6."""
    face = geometry.faces[index]
    a = geometry.vertices[face[0]] - origin
    b = geometry.vertices[face[1]] - origin
    c = geometry.vertices[face[2]] - origin
    return wp.vec3(
        wp.dot(direction, wp.cross(c, b)),
        wp.dot(direction, wp.cross(a, c)),
        wp.dot(direction, wp.cross(b, a)),
    )


@wp.func
def meets_edge(geometry: Geometry, index: int, origin: wp.vec3, direction: wp.vec3, slack: float):
    """Whether a ray meets an edge of a face, or might.

    `slack` is in squares of the distance of the farthest vertex, by which roundings grow.
    """
    v = edge_volumes(geometry, index, origin, direction)
    face = geometry.faces[index]
    a = geometry.vertices[face[0]] - origin
    b = geometry.vertices[face[1]] - origin
    c = geometry.vertices[face[2]] - origin
    gap = slack * wp.max(wp.max(wp.dot(a, a), wp.dot(b, b)), wp.dot(c, c))
    low = wp.min(v)
    high = wp.max(v)
    return (low >= -gap and low <= gap) or (high >= -gap and high <= gap)


@wp.func
def crossing_of(geometry: Geometry, index: int, origin: wp.vec3, direction: wp.vec3):
    """A ray's crossing of a boundary face: 1 along its normal, -1 against it, 0 none; its t."""
    v = edge_volumes(geometry, index, origin, direction)
    same = (v[0] >= 0.0 and v[1] >= 0.0 and v[2] >= 0.0) or (
        v[0] <= 0.0 and v[1] <= 0.0 and v[2] <= 0.0
    )
    crossing = int(0)
    t = float(0.0)
    if same and v[0] + v[1] + v[2] != 0.0:
        face = geometry.faces[index]
        a = geometry.vertices[face[0]] - origin
        b = geometry.vertices[face[1]] - origin
        c = geometry.vertices[face[2]] - origin
        normal = wp.cross(b - a, c - a)
        along = wp.dot(normal, direction)
        t = wp.dot(normal, a) / along
        if t >= 0.0:
            crossing = wp.where(along < 0.0, -1, 1)
    return crossing, t


@wp.func
def add_entry(entries: Entries, ray: int, count: int, t: float, tet: int):
    """Sort an entry in among `count` others, if there is room; returns how many there are now."""
    place = wp.min(count, MOST_ENTRIES)
    if count < MOST_ENTRIES:
        while place > 0 and entries.t[wp.max(place - 1, 0), ray] > t:
            entries.t[place, ray] = entries.t[place - 1, ray]
            entries.tet[place, ray] = entries.tet[place - 1, ray]
            place -= 1
        entries.t[place, ray] = t
        entries.tet[place, ray] = tet
    return count + 1


@wp.func
def find_entries(
    geometry: Geometry,
    origin: wp.vec3,
    direction: wp.vec3,
    ray: int,
    entries: Entries,
    edges_too: bool,
):
    """Fill a ray's entries; returns their number, 0 if the ray meets nothing, or UNKNOWN.

    Pose.refresh_face_boxes comes before.

    Args:
        edges_too: A constant.  If true, rays that meet an edge are UNKNOWN and search.  If false,
            they don't, and of a million rays about one ends too early.
    """
    facing = orientation(geometry)
    count = int(0)
    exits = int(0)
    query = wp.bvh_query_ray(geometry.face_boxes, origin, direction)
    index = int(0)
    while wp.bvh_query_next(query, index):
        crossing, t = crossing_of(geometry, index, origin, direction)
        if edges_too and meets_edge(geometry, index, origin, direction, EDGE_SLACK):
            exits = int(MAX_TETS)  # so that entries and exits don't pair up
        if float(crossing) * facing > 0.0:
            exits += 1
        elif crossing != 0:
            count = add_entry(entries, ray, count, t, geometry.boundary_tets[index])
    if count != exits or count > MOST_ENTRIES:
        count = UNKNOWN
    entries.count[ray] = count
    entries.next[ray] = 0
    return count


@wp.func
def next_entry(
    geometry: Geometry,
    entries: Entries,
    ray: int,
    origin: wp.vec3,
    direction: wp.vec3,
    t: float,
    searches: bool,
):
    """Find the next tet that a ray enters at or behind t: tet (-1: none), t of entry.

    Args:
        searches: A constant.  If it is false, the kernel lacks `enter_mesh`, and may be called for
            rays with known entries alone: others meet nothing.
    """
    count = int(UNKNOWN)
    if entries.count.shape[0] > 0:
        count = entries.count[ray]
    tet = int(-1)
    entry = float(t)
    if count == UNKNOWN:
        if searches:
            tet, entry = enter_mesh(geometry, origin, direction, t)
    else:
        place = entries.next[ray]
        if place < count:
            entries.next[ray] = place + 1
            tet = entries.tet[place, ray]
            entry = wp.max(t, entries.t[place, ray])
    return tet, entry
