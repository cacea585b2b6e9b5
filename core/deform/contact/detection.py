"""Find the contacts of each surface sample within a frame, in touched clusters (boxes.py).

    near  Within the frame, a sample in front of a face comes closer to it than the margin.
          Substeps project such a contact only while it is violated: it is an inequality.
    deep  A sample is inside a tet, and has to leave the body through a face.  The first choice is
          the nearest face, if the sample is less than a tolerance behind it.  Otherwise, take the
          point at rest with the same barycentric coordinates in the tet: the sample leaves through
          the face that is nearest to this point at rest.  It keeps this face until another one
          is much nearer, so that it is not pulled to and fro.  Near a sharp edge, a sample less
          deep than the tolerance gets a face only once it is clear which one it is behind.

A sample has contacts with at most MOST faces, the nearest ones, no two of which look the same way:
a sample near an edge within a plane would be pushed twice, and bodies tremble as it gets there and
leaves.  Inverted faces and tets are ignored: they have no outside.
tests/support/contact_search.py has the same in float64.

Shapes: G clusters, L leaves, S samples, F faces, T tets.
"""

import warp as wp

from ..arrays import VertexArrays
from .boxes import FAR, ContactShape, overlap, way_of

wp.set_module_options({"enable_backward": False})

MOST = 4  # contacts of a sample
IN_FRONT, BEHIND, BEHIND_RIM = 0, 1, 2
BESIDE = 1.01  # times the height: at a larger distance a point is beside the face
NO_FACE = -1
DEEP = -2  # a deep contact with face f is listed as DEEP - f
KEPT = 1.5  # a point leaves where it left before until another face is so many times nearer
NOBODY = 2**31 - 1  # an index after all others
ONE_WAY, EACH_FACE = 0.95, 2.0  # the largest cosine between faces of which each counts
LEAST_VOLUME = 0.1  # of a tet at rest; a flatter one has no inside


@wp.func
def closest_weights(r: wp.vec3, e1: wp.vec3, e2: wp.vec3):
    """Barycentric coordinates of the point of the triangle 0, e1, e2 that is nearest to r."""
    normal = wp.cross(e1, e2)
    squared = wp.dot(normal, normal)
    second = wp.dot(wp.cross(r, e2), normal) / squared
    third = wp.dot(wp.cross(e1, r), normal) / squared
    weights = wp.vec3(1.0 - second - third, second, third)
    if wp.min(weights) >= 0.0:
        return weights
    s = wp.clamp(wp.dot(r, e1) / wp.dot(e1, e1), 0.0, 1.0)
    nearest = wp.length_sq(r - s * e1)
    weights = wp.vec3(1.0 - s, s, 0.0)
    s = wp.clamp(wp.dot(r, e2) / wp.dot(e2, e2), 0.0, 1.0)
    away = wp.length_sq(r - s * e2)
    if away < nearest:
        nearest = away
        weights = wp.vec3(1.0 - s, 0.0, s)
    way = e2 - e1
    s = wp.clamp(wp.dot(r - e1, way) / wp.dot(way, way), 0.0, 1.0)
    if wp.length_sq(r - e1 - s * way) < nearest:
        weights = wp.vec3(0.0, 1.0 - s, s)
    return weights


@wp.func
def distance_within_frame(
    shape: ContactShape,
    state: VertexArrays,
    face: int,
    point: wp.vec3,
    way: wp.vec3,
    dt: float,
    margin: float,
    tolerance: float,
):
    """How near the point comes to the front of a face; FAR if not nearer than the margin.

    Also whether it is behind the face already, but less deep than the tolerance: BEHIND, or
    BEHIND_RIM beside it or where another face may be as near.
    """
    corners = shape.faces[face]
    a = state.vertices[corners[0]]
    e1 = state.vertices[corners[1]] - a
    e2 = state.vertices[corners[2]] - a
    normal = wp.cross(e1, e2)
    area = wp.length(normal)
    if not area > 0.0:
        return FAR, IN_FRONT
    normal /= area
    if wp.dot(normal, state.vertices[shape.opposite[face]] - a) >= 0.0:
        return FAR, IN_FRONT
    r = point - a
    height = wp.dot(normal, r)
    if height < -tolerance:
        return FAR, IN_FRONT
    w = closest_weights(r, e1, e2)
    for i in range(3):
        way -= w[i] * way_of(state, corners[i], dt)
    closing = wp.max(-wp.dot(normal, way), 0.0)
    if height - closing > margin:
        return FAR, IN_FRONT
    share = float(0.0)
    if closing > 0.0:
        share = wp.clamp(height / closing, 0.0, 1.0)
    r += share * way
    w = closest_weights(r, e1, e2)
    distance = wp.length(r - w[1] * e1 - w[2] * e2)
    if distance > margin:
        return FAR, IN_FRONT
    where = int(IN_FRONT)
    if height < 0.0 and distance <= tolerance:
        where = BEHIND
        if distance > BESIDE * -height:
            where = BEHIND_RIM
        for i in range(3):
            if w[i] < shape.rims[face][i] or w[i] > shape.tops[face][i]:
                where = BEHIND_RIM
    return distance, where


@wp.func
def unit_normal(shape: ContactShape, state: VertexArrays, face: int):
    corners = shape.faces[face]
    a = state.vertices[corners[0]]
    return wp.normalize(wp.cross(state.vertices[corners[1]] - a, state.vertices[corners[2]] - a))


@wp.func
def without_alike(
    shape: ContactShape, state: VertexArrays, faces: wp.vec4i, nearest: int, alike: float
):
    """The nearest and those of the faces [4] that look another way than those before."""
    kept = wp.vec4i(NO_FACE)
    kept[0] = nearest
    count = int(1)
    for i in range(4):
        face = faces[i]
        other = bool(count < 4 and face != NO_FACE)
        for j in range(count):
            if other:
                cosine = wp.dot(unit_normal(shape, state, face), unit_normal(shape, state, kept[j]))
                other = face != kept[j] and cosine <= alike
        if other:
            kept[count] = face
            count += 1
    return kept


@wp.func
def inside_at_rest(shape: ContactShape, state: VertexArrays, tet: int, point: wp.vec3):
    """The rest position of a point inside a tet, and 1; 0 if it is outside."""
    t = shape.tets[tet]
    a = state.vertices[t[0]]
    e1 = state.vertices[t[1]] - a
    e2 = state.vertices[t[2]] - a
    e3 = state.vertices[t[3]] - a
    r = point - a
    volume = wp.dot(wp.cross(e1, e2), e3)
    b1 = wp.dot(wp.cross(r, e2), e3)
    b2 = wp.dot(wp.cross(e1, r), e3)
    b3 = wp.dot(wp.cross(e1, e2), r)
    if wp.min(wp.min(b1, b2), wp.min(b3, volume - b1 - b2 - b3)) < 0.0:
        return wp.vec3(), 0
    origin = shape.rest[t[0]]
    u1 = shape.rest[t[1]] - origin
    u2 = shape.rest[t[2]] - origin
    u3 = shape.rest[t[3]] - origin
    if not volume > LEAST_VOLUME * wp.dot(wp.cross(u1, u2), u3):
        return wp.vec3(), 0
    return origin + (b1 * u1 + b2 * u2 + b3 * u3) / volume, 1


@wp.func
def rest_distance(shape: ContactShape, face: int, point: wp.vec3):
    corners = shape.faces[face]
    a = shape.rest[corners[0]]
    e1 = shape.rest[corners[1]] - a
    e2 = shape.rest[corners[2]] - a
    w = closest_weights(point - a, e1, e2)
    return wp.length(point - a - w[1] * e1 - w[2] * e2)


@wp.func
def exit_of(shape: ContactShape, tet: int, point: wp.vec3, before: int):
    """The exit that is nearest to a rest position in a tet, or the one before if nearly so."""
    best = int(NO_FACE)
    nearest = float(FAR)
    nearest_before = float(FAR)
    for i in range(shape.exits.shape[1]):
        face = shape.exits[tet, i]
        if face != NO_FACE:
            away = rest_distance(shape, face, point)
            if away < nearest:
                nearest = away
                best = face
            if face == before:
                nearest_before = away
    if nearest_before < KEPT * nearest:
        best = before
    return best


@wp.func
def known_exit(shape: ContactShape, tet: int, face: int):
    """The face if it is an exit of the tet, else NO_FACE."""
    for i in range(shape.exits.shape[1]):
        if shape.exits[tet, i] == face:
            return face
    return NO_FACE


# What the lanes of a group, which share a sample, have in common.  On a CPU a group is one thread.
@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int other = 4; other > 0; other /= 2)
        v = fminf(v, __shfl_xor_sync(0xffu << (threadIdx.x & 24), v, other));
#endif
    return v;
""")
def least(v: float) -> float: ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int other = 4; other > 0; other /= 2)
        v = min(v, __shfl_xor_sync(0xffu << (threadIdx.x & 24), v, other));
#endif
    return v;
""")
def first(v: int) -> int: ...


@wp.func
def first_of_least(v: float, index: int):
    """The lowest index of the lanes whose value is the least, and that value."""
    lowest = least(v)
    if v > lowest:
        index = NOBODY
    return lowest, first(index)


def lane_count(device) -> int:
    """Threads that share a sample."""
    return 8 if device.is_cuda else 1


@wp.kernel(grid_stride=False)
def find_kernel(
    shape: ContactShape,
    state: VertexArrays,
    leaf_boxes: wp.array2d(dtype=wp.vec3),  # [L, 2]
    face_boxes: wp.array2d(dtype=wp.vec3),  # [F, 2]
    tet_boxes: wp.array2d(dtype=wp.vec3),  # [T, 2]
    touched: wp.array(dtype=int),  # [G]
    overlaps: wp.array2d(dtype=int),  # [G, G]
    dt: float,
    margin: float,
    tolerance: float,
    alike: float,  # ONE_WAY or EACH_FACE
    lanes: int,  # lane_count
    exits: wp.array(dtype=int),  # [S] in and out: the face where a sample leaves, or NO_FACE
    found: wp.array(dtype=wp.vec4i),  # [S] out: faces, DEEP - face, or NO_FACE
    counts: wp.array(dtype=int),  # [S] out
    contact_counts: wp.array(dtype=int),  # [2] out: zeros
):
    s = wp.tid() // lanes
    lane = wp.tid() % lanes
    if s < 2:
        contact_counts[s] = 0
    cluster = shape.sample_clusters[s]
    if touched[cluster] == 0:
        counts[s] = 0
        exits[s] = NO_FACE
        return
    p = shape.ends[s][0]
    q = shape.ends[s][1]
    share = shape.shares[s]
    point = (1.0 - share) * state.vertices[p] + share * state.vertices[q]
    way = (1.0 - share) * way_of(state, p, dt) + share * way_of(state, q, dt)
    lower = wp.min(point, point + way)
    upper = wp.max(point, point + way)
    distances = wp.vec4(FAR)
    faces = wp.vec4i(NO_FACE)
    before = exits[s]
    behind = int(NO_FACE)
    behind_at = float(FAR)
    before_at = float(FAR)
    shallow = bool(False)
    inside = int(0)
    tet_around = int(0)
    at_rest = wp.vec3()
    for k in range(touched[cluster]):
        other = overlaps[cluster, k]
        for leaf in range(shape.leaf_offsets[other], shape.leaf_offsets[other + 1]):
            if not overlap(lower, upper, leaf_boxes, leaf):
                continue
            for face in range(shape.face_offsets[leaf] + lane, shape.face_offsets[leaf + 1], lanes):
                if not overlap(lower, upper, face_boxes, face):
                    continue
                distance, where = distance_within_frame(
                    shape, state, face, point, way, dt, margin, tolerance
                )
                if where != IN_FRONT:
                    shallow = True
                if where == BEHIND:
                    if distance < behind_at:
                        behind = face
                        behind_at = distance
                    if face == before:
                        before_at = distance
                if distance < distances[3]:
                    new = face
                    for i in range(4):  # sorted by distance
                        if distance < distances[i]:
                            d = distances[i]
                            f = faces[i]
                            distances[i] = distance
                            faces[i] = new
                            distance = d
                            new = f
            if inside == 0:
                for tet in range(
                    shape.tet_offsets[leaf] + lane, shape.tet_offsets[leaf + 1], lanes
                ):
                    if inside == 0 and overlap(point, point, tet_boxes, tet):
                        at_rest, inside = inside_at_rest(shape, state, tet, point)
                        tet_around = tet
    if lanes > 1:
        own_distances = distances
        own_faces = faces
        for i in range(4):
            distance, face = first_of_least(own_distances[0], own_faces[0])
            distances[i] = distance
            faces[i] = face
            if own_faces[0] == face:
                for j in range(3):
                    own_distances[j] = own_distances[j + 1]
                    own_faces[j] = own_faces[j + 1]
                own_distances[3] = FAR
                own_faces[3] = NO_FACE
        behind_at, behind = first_of_least(behind_at, behind)
        before_at = least(before_at)
        shallow = first(wp.where(shallow, 0, 1)) == 0
        tet = first(wp.where(inside == 1, tet_around, NOBODY))
        mine = inside == 1 and tet == tet_around
        for i in range(3):
            at_rest[i] = least(wp.where(mine, at_rest[i], FAR))
        inside = wp.where(tet == NOBODY, 0, 1)
        tet_around = tet
        if lane > 0:
            return
    leaves_by = int(NO_FACE)
    if inside == 1:
        leaves_by = behind
        if not shallow:
            leaves_by = exit_of(shape, tet_around, at_rest, before)
        elif behind == NO_FACE:
            leaves_by = known_exit(shape, tet_around, before)
        elif before_at < KEPT * behind_at:
            leaves_by = before
    nearest = wp.where(leaves_by == NO_FACE, faces[0], leaves_by)
    if nearest != NO_FACE and alike < EACH_FACE:
        faces = without_alike(shape, state, faces, nearest, alike)
    if leaves_by != NO_FACE:
        place = int(0)
        while place < 3 and faces[place] != leaves_by and faces[place] != NO_FACE:
            place += 1
        faces[place] = DEEP - leaves_by
    exits[s] = leaves_by
    found[s] = faces
    count = int(0)
    for i in range(4):
        if faces[i] != NO_FACE:
            count += 1
    counts[s] = count
