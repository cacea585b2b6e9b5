"""Where rays enter the mesh: all places at once, found in one pass through a BVH of its faces.

Searching anew whenever a ray has left the mesh costs a warp as many passes, one after
another, as its unluckiest ray needs.  Rays that enter more often than there is room for, or
for which entries and exits don't pair up (they start inside, or slipped through an edge),
search as they go: `traversal.enter_mesh`.

Shapes: R rays, B boundary faces.
"""

import warp as wp

from .traversal import QUERY_GAP, Geometry, Pose, enter_mesh, orientation

MOST_ENTRIES = wp.constant(4)
UNKNOWN = wp.constant(-1)  # a ray's count: it searches as it goes

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.struct
class Entries:
    """Entries of each ray, nearest first; without any arrays all rays search as they go."""

    t: wp.array2d(dtype=float)  # [MOST_ENTRIES, R]
    tet: wp.array2d(dtype=int)  # [MOST_ENTRIES, R]
    count: wp.array(dtype=int)  # [R]
    next: wp.array(dtype=int)  # [R] the one to use when the ray is outside


def empty_entries(count: int, device) -> Entries:
    entries = Entries()
    entries.t = wp.empty((MOST_ENTRIES if count else 0, count), dtype=float, device=device)
    entries.tet = wp.empty((MOST_ENTRIES if count else 0, count), dtype=int, device=device)
    entries.count = wp.empty(count, dtype=int, device=device)
    entries.next = wp.empty(count, dtype=int, device=device)
    return entries


class FaceBoxes:
    """A BVH of a pose's boundary faces, up to date after `refresh`."""

    def __init__(self, pose: Pose):
        self._pose, self._revision = pose, -1
        with wp.ScopedDevice(pose.device):
            self.faces = wp.array(pose.boundary_faces, dtype=wp.vec3i)
            self._lowers = wp.empty(len(self.faces), dtype=wp.vec3)
            self._uppers = wp.empty(len(self.faces), dtype=wp.vec3)
        self._bvh = None

    @property
    def id(self):
        return self._bvh.id

    def refresh(self) -> None:
        """Take the pose's present vertices, if they have changed."""
        if self._revision == self._pose.revision:
            return
        self._revision = self._pose.revision
        wp.launch(
            face_boxes_kernel,
            dim=len(self.faces),
            inputs=[self._pose.vertices, self.faces],
            outputs=[self._lowers, self._uppers],
            device=self._pose.device,
        )
        if self._bvh is None:
            self._bvh = wp.Bvh(self._lowers, self._uppers)
        else:
            self._bvh.refit()


@wp.kernel
def face_boxes_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V]
    faces: wp.array(dtype=wp.vec3i),  # [B]
    lowers: wp.array(dtype=wp.vec3),  # [B] out
    uppers: wp.array(dtype=wp.vec3),  # [B] out
):
    i = wp.tid()
    face = faces[i]
    a = vertices[face[0]]
    b = vertices[face[1]]
    c = vertices[face[2]]
    gap = wp.vec3(QUERY_GAP, QUERY_GAP, QUERY_GAP)  # a ray in the plane of a flat box meets it
    lowers[i] = wp.min(wp.min(a, b), c) - gap
    uppers[i] = wp.max(wp.max(a, b), c) + gap


@wp.func
def crossing_of(
    vertices: wp.array(dtype=wp.vec3), face: wp.vec3i, origin: wp.vec3, direction: wp.vec3
):
    """How a ray crosses a face: 1 along its normal, -1 against it, 0 not; and where."""
    a = vertices[face[0]] - origin
    b = vertices[face[1]] - origin
    c = vertices[face[2]] - origin
    # Volumes of the tets that the ray spans with the edges: all of one sign inside.
    u = wp.dot(direction, wp.cross(c, b))
    v = wp.dot(direction, wp.cross(a, c))
    w = wp.dot(direction, wp.cross(b, a))
    same = (u >= 0.0 and v >= 0.0 and w >= 0.0) or (u <= 0.0 and v <= 0.0 and w <= 0.0)
    crossing = int(0)
    t = float(0.0)
    if same and u + v + w != 0.0:
        normal = wp.cross(b - a, c - a)
        along = wp.dot(normal, direction)
        t = wp.dot(normal, a) / along
        if t >= 0.0:
            crossing = wp.where(along < 0.0, -1, 1)
    return crossing, t


@wp.func
def find_entries(
    geometry: Geometry,
    boxes: wp.uint64,  # id of FaceBoxes
    vertices: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    origin: wp.vec3,
    direction: wp.vec3,
    ray: int,
    entries: Entries,
):
    """Fill a ray's entries; returns their number, 0 if the ray meets nothing, or UNKNOWN."""
    facing = orientation(geometry)
    count = int(0)
    exits = int(0)
    query = wp.bvh_query_ray(boxes, origin, direction)
    index = int(0)
    while wp.bvh_query_next(query, index):
        crossing, t = crossing_of(vertices, faces[index], origin, direction)
        if float(crossing) * facing > 0.0:
            exits += 1
        elif crossing != 0:
            place = wp.min(count, MOST_ENTRIES)
            if count < MOST_ENTRIES:
                while place > 0 and entries.t[wp.max(place - 1, 0), ray] > t:
                    entries.t[place, ray] = entries.t[place - 1, ray]
                    entries.tet[place, ray] = entries.tet[place - 1, ray]
                    place -= 1
                entries.t[place, ray] = t
                entries.tet[place, ray] = geometry.boundary_tets[index]
            count += 1
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
):
    """The tet that a ray outside the mesh at t enters next, or -1, and where it is in it."""
    count = int(UNKNOWN)
    if entries.count.shape[0] > 0:
        count = entries.count[ray]
    tet = int(-1)
    entry = float(t)
    if count == UNKNOWN:
        tet, entry = enter_mesh(geometry, origin, direction, t)
    else:
        place = entries.next[ray]
        if place < count:
            entries.next[ray] = place + 1
            tet = entries.tet[place, ray]
            entry = wp.max(t, entries.t[place, ray])
    return tet, entry
