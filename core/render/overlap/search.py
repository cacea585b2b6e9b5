"""Find the rays through self-overlap, where a walk from tet to tet would miss some tets.

The mesh does not overlap itself if

- all its tets have one orientation, and none is nearly flat,
- no edge of the boundary touches a face with which it shares no vertex, and
- no part lies inside another.

That is enough: a map that keeps orientation and is one to one on the boundary is one to one inside.
`search_kernel` checks it once per pose.  Without overlap, this module does no more.

With overlap, it classifies each ray.  A ray is *tangled* if it meets a tet that is inverted or
nearly flat, or if it is inside two boundary shells at once.  If rounding makes that uncertain, the
ray counts as tangled, which costs time and changes no image.  The walk renders all rays that are
not tangled; window_slots.py, windows.py and merging.py render the others.

Shapes: R rays, T tets, V vertices, B boundary faces, C parts (connected through faces).
"""

import numpy as np
import warp as wp

from ...base.recorded import Recorded
from ...base.threads import counted, shares_of
from ...geometry import TetMesh, edges, face_components
from ..rays.entries import crossing_of
from ..rays.marching import Rays
from ..rays.pose import Geometry, Pose, box_tree
from ..rays.traversal import FADED, interval_in_tet, orientation

TANGLED_TETS, CROSSINGS = 0, 1  # places in a pose's counts
PLAIN, TANGLED = 0, 1  # places in the counts of rays
EDGES_PER_THREAD = 400  # of a CPU, at least: 0.2 ms
BLOCK_SIZE = 128  # threads: the stacks of more don't fit into a GPU's shared memory
COPLANAR = wp.constant(1.0e-5)  # of the largest possible volume: float32 can't tell it from 0
MOST_CROSSINGS = wp.constant(8)  # of a ray; with more it is tangled
TOUCHING = wp.constant(1.0e-6)  # in t: shells this close may be inside each other
PROBE = wp.constant(wp.vec3(0.4124, 0.5763, 0.7056))  # a direction along no plane of a lattice
crossings_vector = wp.types.vector(8, wp.float32)

wp.set_module_options({"enable_backward": False, "max_unroll": 2, "block_dim": BLOCK_SIZE})


class Overlap:
    """Finds out whether a pose overlaps itself, once per change of its vertices; sorts rays.

    Attributes:
        expected: What `exists` said last.
        tangled: What makes rays tangled; `prepare` fills it, `exists` its `shells`.
        counts: Of the pose that was searched last, on the device: tangled tets, crossings.  [2]
    """

    def __init__(self, mesh: TetMesh, neighbours, pose: Pose):
        self._pose = pose
        self._searched = self._found = self._prepared = -1  # revisions of the pose
        self._count, self.expected = 0, False  # tangled tets
        self._tangled_boxes = None  # BVH of the tets that are inverted or nearly flat
        self.tangled = TangledTets()
        self.tangled.shells = 0
        faces, labels = pose.boundary_faces, face_components(neighbours)
        _, first_tets = np.unique(labels, return_index=True)  # one of each part
        if len(first_tets) == 1:  # which is in no other
            first_tets = first_tets[:0]
        # `edges` takes tets: with the first corner twice it finds those of a face, and loops.
        boundary_edges = edges(np.concatenate([faces, faces[:, :1]], axis=1))
        with wp.ScopedDevice(pose.device):
            self._edges = wp.array(boundary_edges, dtype=wp.vec2i)
            self._part_tets = wp.array(mesh.tets[first_tets], dtype=wp.vec4i)
            self.counts = wp.zeros(2, dtype=int)
            self.tangled.ids = wp.empty(mesh.tet_count, dtype=int)
        self._host_counts = wp.zeros(2, dtype=int, device="cpu", pinned=pose.device.is_cuda)
        self._stream = wp.Stream(pose.device) if pose.device.is_cuda else None
        self._counted = wp.Event(pose.device) if pose.device.is_cuda else None
        self._searching = Recorded(pose.device)
        self._launches = None  # on a CPU: each with what it counts

    def exists(self) -> bool:
        """Whether the present pose overlaps itself; waits for the device after a change."""
        self.search()
        if self._found != self._pose.revision:
            if self._counted:
                wp.synchronize_event(self._counted)
            self._count, crossings = (int(n) for n in self._host_counts.numpy())
            self.tangled.shells = int(crossings > 0)
            self.expected = self._count > 0 or crossings > 0
            self._found = self._pose.revision
        return self.expected

    def search(self) -> None:
        """Start the search on the device if the vertices have changed; does not wait.

        On CUDA it runs on a stream of its own, beside what is launched later: `join` before
        launches that read what it finds, or change the pose.
        """
        pose = self._pose
        if self._searched == pose.revision:
            return
        if len(self._part_tets):
            pose.refresh_face_boxes()
        if self._stream is None:
            self._launch_search()
        else:
            with wp.ScopedStream(self._stream, sync_enter=True):
                self._searching(self._launch_search)
                self._stream.record_event(self._counted)
        self._searched = pose.revision

    def join(self) -> None:
        """Let what is launched from now on wait on the device for the search."""
        if self._stream is not None:
            wp.get_stream(self._pose.device).wait_event(self._counted)

    def _launch_search(self):
        if self._pose.device.is_cpu:
            self._launches = self._launches or self._launches_for_threads()
            found = counted(self._launches)
            self.counts.assign(found)
            self._host_counts.assign(found)
            return
        pose, tet_count = self._pose, len(self._pose.tets)
        self.counts.zero_()
        threads = tet_count + len(self._edges) + len(self._part_tets)
        inputs = [pose.geometry, tet_count, self._edges, self._part_tets]
        outputs = [self.counts, self.tangled.ids]
        where = {"device": pose.device, "block_dim": BLOCK_SIZE}
        wp.launch(search_kernel, threads, inputs, outputs, **where)
        wp.copy(self._host_counts, self.counts)

    def _launches_for_threads(self):
        """A launch for some edges in each thread, with its counts; the first has the tets, too."""
        geometry, ids = self._pose.geometry, self.tangled.ids
        tet_count, part_tets, launches = len(self._pose.tets), self._part_tets, []
        for first, end in shares_of(len(self._edges), EDGES_PER_THREAD):
            counts = wp.zeros(2, dtype=int, device="cpu")
            threads = tet_count + end - first + len(part_tets)
            arrays = [geometry, tet_count, self._edges[first:end], part_tets], [counts, ids]
            where = {"device": "cpu", "block_dim": BLOCK_SIZE, "record_cmd": True}
            launches.append((wp.launch(search_kernel, threads, *arrays, **where), counts.numpy()))
            tet_count, part_tets = 0, wp.empty(0, dtype=wp.vec4i, device="cpu")
        return launches

    def prepare(self) -> None:
        """Make what `sort_rays` needs in the present pose."""
        self._pose.refresh_face_boxes()
        if self._prepared != self._pose.revision:
            pose, self.tangled.boxes = self._pose, 0  # before the old tree goes
            self._tangled_boxes = None
            if self.exists() and self._count:
                ids = self.tangled.ids[: self._count]
                self._tangled_boxes = box_tree(pose.vertices, pose.tets, ids)
                self.tangled.boxes = self._tangled_boxes.id
            self._prepared = pose.revision

    def sort_rays(self, rays: Rays, ids: wp.array):
        """The plain and the tangled ones of the rays `ids`.

        `prepare` comes before.
        """
        device, count = self._pose.device, len(ids)
        counts = wp.zeros(2, dtype=int, device=device)
        plain = wp.empty(count, dtype=int, device=device)
        tangled = wp.empty(count, dtype=int, device=device)
        inputs = [self._pose.geometry, rays.origins, rays.directions, ids, self.tangled]
        outputs, where = [counts, plain, tangled], {"device": device, "block_dim": BLOCK_SIZE}
        wp.launch(sort_rays_kernel, count, inputs, outputs, **where)
        plain_count, tangled_count = counts.numpy()
        return plain[: int(plain_count)], tangled[: int(tangled_count)]


@wp.func
def is_tangled_tet(geometry: Geometry, tet: int):
    """Whether its orientation is not that of most, or it is so flat that it fades."""
    shape = geometry.shapes[2 * tet + 1]
    return orientation(geometry) * shape[3] <= 0.0 or shape[2] < FADED


@wp.func
def may_meet(geometry: Geometry, tet: int, origin: wp.vec3, direction: wp.vec3):
    """Whether a ray that comes near a tet may meet it."""
    met = bool(True)  # it may be too flat to have coordinates
    if geometry.shapes[2 * tet + 1][2] > 0.0:
        _alpha, _slope, _near, t_in, t_out = interval_in_tet(geometry, tet, origin, direction)
        met = t_out >= t_in
    return met


@wp.func
def side(a: wp.vec3, b: wp.vec3, c: wp.vec3, p: wp.vec3):
    """The side of the plane through a, b, c with the point p: -1, 1, or 0 in the plane."""
    normal = wp.cross(b - a, c - a)
    volume = wp.dot(normal, p - a)
    most = wp.length(normal) * wp.length(p - a)
    return wp.where(wp.abs(volume) <= COPLANAR * most, 0, wp.where(volume < 0.0, -1, 1))


@wp.func
def touches(p: wp.vec3, q: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Whether the line segment from p to q goes through the triangle a, b, c, or ends on it.

    A segment in the plane of the triangle does not count: where volumes overlap, other edges
    cross it.
    """
    from_side = side(a, b, c, p)
    to_side = side(a, b, c, q)
    through = from_side * to_side <= 0 and from_side != to_side
    if through:
        ab = side(p, q, a, b)
        bc = side(p, q, b, c)
        ca = side(p, q, c, a)
        through = ab * bc >= 0 and bc * ca >= 0 and ab * ca >= 0
    return through


@wp.func
def is_crossed(geometry: Geometry, edge: wp.vec2i):
    """Whether a boundary edge touches a boundary face with which it shares no vertex."""
    i = edge[0]
    j = edge[1]
    p = geometry.vertices[i]
    q = geometry.vertices[j]
    query = wp.mesh_query_aabb(geometry.boundary, wp.min(p, q), wp.max(p, q))
    index = int(0)
    while wp.mesh_query_aabb_next(query, index):
        face = geometry.faces[index]
        beside = face[0] == i or face[1] == i or face[2] == i
        beside = beside or face[0] == j or face[1] == j or face[2] == j
        if not beside:
            a = geometry.vertices[face[0]]
            b = geometry.vertices[face[1]]
            c = geometry.vertices[face[2]]
            if touches(p, q, a, b, c):
                return True
    return False


@wp.func
def is_nested(geometry: Geometry, corners: wp.vec4i):
    """Whether the middle of a tet is not inside exactly one shell, that of the tet's part.

    A ray ends outside of all shells, so the signs of its crossings add up to the number of
    shells around its origin.
    """
    vertices = geometry.vertices
    point = vertices[corners[0]] + vertices[corners[1]] + vertices[corners[2]]
    point = 0.25 * (point + vertices[corners[3]])
    facing = orientation(geometry)
    shells = int(0)
    query = wp.bvh_query_ray(geometry.face_boxes, point, PROBE)
    index = int(0)
    while wp.bvh_query_next(query, index):
        crossing, _t = crossing_of(geometry, index, point, PROBE)
        shells += int(facing) * crossing
    return shells != 1


@wp.kernel
def search_kernel(
    geometry: Geometry,
    tet_count: int,
    boundary_edges: wp.array(dtype=wp.vec2i),  # [E]
    part_tets: wp.array(dtype=wp.vec4i),  # [C] corners of a tet of each part
    counts: wp.array(dtype=int),  # [2] added to
    tangled: wp.array(dtype=int),  # [T] out, in no particular order
):
    """Find tangled tets; count crossed edges, up to some, and nested parts.

    Threads for tets come first, then those for edges and parts: side by side they take as long
    as the slowest.
    """
    i = wp.tid()
    edge = i - tet_count
    part = edge - boundary_edges.shape[0]
    found = bool(False)
    if edge < 0:
        if is_tangled_tet(geometry, i):
            tangled[wp.atomic_add(counts, wp.static(TANGLED_TETS), 1)] = i
    elif part >= 0:
        found = is_nested(geometry, part_tets[part])
    elif counts[wp.static(CROSSINGS)] == 0:  # one is enough
        found = is_crossed(geometry, boundary_edges[edge])
    if found:
        wp.atomic_add(counts, wp.static(CROSSINGS), 1)


@wp.func
def is_inside_two_shells(geometry: Geometry, origin: wp.vec3, direction: wp.vec3):
    """Whether a ray may be inside two shells of the boundary at any t."""
    facing = int(orientation(geometry))
    places = crossings_vector()
    signs = crossings_vector()  # 1 where it leaves, -1 where it enters
    count = int(0)
    start = int(0)
    query = wp.bvh_query_ray(geometry.face_boxes, origin, direction)
    index = int(0)
    while wp.bvh_query_next(query, index):
        crossing, t = crossing_of(geometry, index, origin, direction)
        if crossing != 0:
            start += facing * crossing
            if count < MOST_CROSSINGS:
                places[count] = t
                signs[count] = float(facing * crossing)
            count += 1
    if start < 0 or start > 1 or count > MOST_CROSSINGS:
        return True
    i = int(0)
    while i < count:
        depth = int(start)  # right behind place i; close to it, entries count and exits do not
        j = int(0)
        while j < count:
            if signs[j] < 0.0 and places[j] <= places[i] + TOUCHING:
                depth += 1
            if signs[j] > 0.0 and places[j] < places[i] - TOUCHING:
                depth -= 1
            j += 1
        if signs[i] < 0.0 and depth != 1:
            return True
        i += 1
    return False


@wp.struct
class TangledTets:
    """What makes a ray of the present pose tangled."""

    boxes: wp.uint64  # id of a BVH of tets that are inverted or nearly flat; 0 without any
    ids: wp.array(dtype=int)  # [T] those tets
    shells: int  # 1 if the boundary intersects itself


@wp.func
def is_tangled(geometry: Geometry, tangled: TangledTets, origin: wp.vec3, direction: wp.vec3):
    """Whether a walk from tet to tet might miss a tet of this ray."""
    found = bool(False)
    if tangled.boxes != wp.uint64(0):
        query = wp.bvh_query_ray(tangled.boxes, origin, direction)
        index = int(0)
        while not found and wp.bvh_query_next(query, index):
            found = may_meet(geometry, tangled.ids[index], origin, direction)
    if not found and tangled.shells == 1:
        found = is_inside_two_shells(geometry, origin, direction)
    return found


@wp.kernel
def sort_rays_kernel(
    geometry: Geometry,
    origins: wp.array(dtype=wp.vec3),  # [R]
    directions: wp.array(dtype=wp.vec3),  # [R]
    ids: wp.array(dtype=int),  # [threads] ray of each thread
    tangled_tets: TangledTets,
    counts: wp.array(dtype=int),  # [2] out: plain and tangled rays
    plain: wp.array(dtype=int),  # [threads] out: which rays
    tangled: wp.array(dtype=int),  # [threads] out
):
    """Sort rays into plain and tangled ones."""
    ray = ids[wp.tid()]
    if is_tangled(geometry, tangled_tets, origins[ray], directions[ray]):
        tangled[wp.atomic_add(counts, wp.static(TANGLED), 1)] = ray
    else:
        plain[wp.atomic_add(counts, wp.static(PLAIN), 1)] = ray
