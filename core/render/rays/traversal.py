"""Where a ray goes through the deformed mesh.

Per pose, each tet k gets a frame:

    alpha(p)                     barycentric coordinates of a current point, linear in p
    |F_k^-1 d|                   rest length per t, from how alpha changes along d
    Q_k                          orthogonal polar factor of F_k, reflection kept
    s_k                          smoothstep(1e-3, 1e-2, σ_min/σ_max of F_k): flat tets fade

A ray enters through the boundary mesh (a BVH refitted per pose) and then walks across
faces; within a tet alpha(t) is linear, so the exit is where the first coordinate that
falls reaches zero.

Shapes: T tets, V vertices, B boundary faces.  Model units.
"""

import numpy as np
import warp as wp

from ...field import load_wide, load_wide_int
from ...geometry import TetMesh, boundary_faces

# A boundary query looks this far around t for faces that rounding has moved across it.
QUERY_GAP = wp.constant(4.0e-6)
# Two units of the last place of t per face: a ray through an edge or a vertex, where
# rounding makes the tets around it disagree, is carried past it instead of circling.
SMALLEST_ADVANCE = wp.constant(2.4e-7)
FADED = wp.constant(1.0)  # a smaller fade s: a tet so flat that it isn't fully there
# A tet flatter than this (σ_min/σ_max) has no coordinates.  Rays that meet one that fades are
# tangled (overlap.py), so that a walk comes to one by rounding only, and ends there.
FLAT = wp.constant(1.0e-5)
MAX_TETS = wp.constant(4096)  # per ray and round; a walk this long goes in circles

wp.set_module_options({"enable_backward": False, "max_unroll": 4})


def tet_frames_reference(rest_vertices, vertices, tets):
    """The frames of all tets, in NumPy.

    Returns:
        gradients [T, 4, 4] (columns 0-2 G, column 3 g), inverse F [T, 3, 3], Q [T, 3, 3],
        fade s [T].  A faded tet has zeros and s = 0.
    """
    rest_edges = np.swapaxes(rest_vertices[tets[:, 1:]] - rest_vertices[tets[:, :1]], 1, 2)
    edges = np.swapaxes(vertices[tets[:, 1:]] - vertices[tets[:, :1]], 1, 2)
    deformation = edges @ np.linalg.inv(rest_edges)
    u, stretches, vt = np.linalg.svd(deformation)
    ratio = stretches[:, 2] / np.maximum(stretches[:, 0], 1e-30)
    x = np.clip((ratio - 1e-3) / (1e-2 - 1e-3), 0, 1)
    fade = x * x * (3 - 2 * x)
    flat = fade <= 0
    edges = np.where(flat[:, None, None], np.eye(3), edges)
    inverse = np.linalg.inv(edges)
    gradients = np.zeros((len(tets), 4, 4))
    gradients[:, 1:, :3] = inverse
    gradients[:, 1:, 3] = -np.einsum("tij,tj->ti", inverse, vertices[tets[:, 0]])
    gradients[:, 0] = -gradients[:, 1:].sum(axis=1)
    gradients[:, 0, 3] += 1.0
    inverse_f = rest_edges @ inverse
    gradients[flat], inverse_f[flat] = 0.0, 0.0
    return gradients, inverse_f, u @ vt, fade


def links(neighbours):
    """Across each face 4 · tet + the face of that tet, -1 outside.  [T, 4] -> [T, 4] int32"""
    tet, face = np.nonzero(neighbours >= 0)
    across = neighbours[tet, face]
    back = (neighbours[across] == tet[:, None]).argmax(axis=1)
    result = np.full(neighbours.shape, -1, np.int32)
    result[tet, face] = 4 * across + back
    return result


@wp.func
def smoothstep(low: float, high: float, x: float):
    y = wp.clamp((x - low) / (high - low), 0.0, 1.0)
    return y * y * (3.0 - 2.0 * y)


@wp.kernel
def tet_frames_kernel(
    tets: wp.array(dtype=wp.vec4i),  # [T]
    vertices: wp.array(dtype=wp.vec3),  # [V] current
    rest_edges: wp.array(dtype=wp.mat33),  # [T] columns x1-x0, x2-x0, x3-x0 at rest
    rest_edges_inverse: wp.array(dtype=wp.mat33),  # [T]
    rows: wp.array(dtype=wp.vec4),  # [3 T] out, see `Geometry`
    shapes: wp.array(dtype=wp.vec4),  # [2 T] out, see `Geometry`
    rotations: wp.array(dtype=wp.mat33),  # [T] out, Q
    mirrored_count: wp.array(dtype=int),  # [1] added to
):
    i = wp.tid()
    tet = tets[i]
    x0 = vertices[tet[0]]
    edges = wp.matrix_from_cols(vertices[tet[1]] - x0, vertices[tet[2]] - x0, vertices[tet[3]] - x0)
    f = edges * rest_edges_inverse[i]
    u = wp.mat33()
    v = wp.mat33()
    stretches = wp.vec3()
    wp.svd3(f, u, stretches, v)
    # svd3 returns rotations and puts a reflection into the sign of a stretch.
    flips = wp.vec3(wp.sign(stretches[0]), wp.sign(stretches[1]), wp.sign(stretches[2]))
    rotations[i] = u * wp.diag(flips) * wp.transpose(v)
    # A flat tet's least stretch is small against rounding: it comes from the volume.  That and
    # the inverse are float64, or a thin tet's coordinates would be off by its own thickness.
    x0d = wp.vec3d(x0)
    current = wp.matrix_from_cols(
        wp.vec3d(vertices[tet[1]]) - x0d,
        wp.vec3d(vertices[tet[2]]) - x0d,
        wp.vec3d(vertices[tet[3]]) - x0d,
    )
    volume = wp.determinant(current)
    rest_volume = wp.determinant(wp.mat33d(rest_edges[i]))
    a = wp.abs(stretches)
    largest = wp.max(a)
    middle = a[0] + a[1] + a[2] - largest - wp.min(a)
    smallest = wp.abs(float(volume / rest_volume)) / wp.max(largest * middle, 1.0e-30)
    ratio = wp.min(smallest / wp.max(largest, 1.0e-30), 1.0)
    fade = smoothstep(1.0e-3, 1.0e-2, ratio)
    m = wp.mat33d()
    if ratio > FLAT:  # a faded tet has no density, but rays still have to cross it
        m = wp.inverse(current)
    for k in range(3):
        rows[3 * i + k] = wp.vec4(float(m[k, 0]), float(m[k, 1]), float(m[k, 2]), x0[k])
    gram = wp.transpose(rest_edges[i]) * rest_edges[i]
    sign = wp.where(volume < wp.float64(0.0), -1.0, 1.0)
    shapes[2 * i] = wp.vec4(gram[0, 0], gram[1, 1], gram[2, 2], 2.0 * gram[0, 1])
    shapes[2 * i + 1] = wp.vec4(2.0 * gram[0, 2], 2.0 * gram[1, 2], fade, sign)
    if sign < 0.0:
        wp.atomic_add(mirrored_count, 0, 1)


@wp.struct
class Geometry:
    """What a walk needs; one per device, refreshed per pose.

    A tet has three `rows`, the gradients of its last three coordinates, each followed by a
    coordinate of its corner 0, from where they are counted: thin tets have large gradients,
    which would make a large error of an offset from the origin.  And it has two `shapes`:
    products of its edges at rest, e_i · e_j, those of two different ones doubled,
    (11, 22, 33, 12) and (13, 23, s, sign), where sign is -1 if the tet is mirrored.
    """

    boundary: wp.uint64  # id of the wp.Mesh of boundary faces
    boundary_tets: wp.array(dtype=int)  # [B] the tet behind each face
    links: wp.array(dtype=wp.vec4i)  # [T] across each face: 4 · tet + its face, -1 outside
    rows: wp.array(dtype=wp.vec4)  # [3 T]
    shapes: wp.array(dtype=wp.vec4)  # [2 T]
    rotations: wp.array(dtype=wp.mat33)  # [T]
    mirrored_count: wp.array(dtype=int)  # [1]


@wp.func
def orientation(geometry: Geometry):
    """1, or -1 if most tets are mirrored: then the boundary's normals point inwards."""
    return wp.where(2 * geometry.mirrored_count[0] > geometry.links.shape[0], -1.0, 1.0)


@wp.func
def line_in_tet(geometry: Geometry, tet: int, p: wp.vec3, d: wp.vec3):
    """Barycentric coordinates of p, and how they change along d."""
    row1 = load_wide(geometry.rows, 3 * tet)
    row2 = load_wide(geometry.rows, 3 * tet + 1)
    row3 = load_wide(geometry.rows, 3 * tet + 2)
    q = p - wp.vec3(row1[3], row2[3], row3[3])
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


class Pose:
    """The mesh in its current shape on one device: frames, boundary BVH, `geometry`.

    Attributes:
        boundary_faces: Vertex ids.  [B, 3]
        revision: Counts the changes of the vertices.
    """

    def __init__(self, mesh: TetMesh, neighbours, device):
        self.device = wp.get_device(device)
        faces, behind = boundary_faces(mesh.tets, neighbours)
        self.boundary_faces, self.revision = faces, 0
        rest_edges = np.swapaxes(
            mesh.rest_vertices[mesh.tets[:, 1:]] - mesh.rest_vertices[mesh.tets[:, :1]], 1, 2
        )
        with wp.ScopedDevice(self.device):
            self.vertices = wp.array(mesh.rest_vertices.astype(np.float32), dtype=wp.vec3)
            self.tets = wp.array(mesh.tets, dtype=wp.vec4i)
            self._rest_edges = wp.array(rest_edges.astype(np.float32), dtype=wp.mat33)
            self._rest_edges_inverse = wp.array(
                np.linalg.inv(rest_edges).astype(np.float32), dtype=wp.mat33
            )
            # wp.Mesh owns its points: refit reads what set_vertices copied into them.
            self._boundary = wp.Mesh(
                points=wp.clone(self.vertices), indices=wp.array(faces.ravel(), dtype=int)
            )
            geometry = self.geometry = Geometry()
            geometry.boundary = self._boundary.id
            geometry.boundary_tets = wp.array(behind, dtype=int)
            geometry.links = wp.array(links(neighbours), dtype=wp.vec4i)
            geometry.rows = wp.empty(3 * mesh.tet_count, dtype=wp.vec4)
            geometry.shapes = wp.empty(2 * mesh.tet_count, dtype=wp.vec4)
            geometry.rotations = wp.empty(mesh.tet_count, dtype=wp.mat33)
            geometry.mirrored_count = wp.zeros(1, dtype=int)
        self.set_vertices(self.vertices)

    def set_vertices(self, vertices):
        """Take new positions: an array [V, 3] or a wp.array of vec3 on the device."""
        if not isinstance(vertices, wp.array):
            vertices = np.ascontiguousarray(vertices, np.float32)
            vertices = wp.array(vertices, dtype=wp.vec3, device=self.device)
        if vertices.shape != self.vertices.shape:
            raise ValueError(
                f"the mesh has {len(self.vertices)} vertices, {len(vertices)} were given"
            )
        if vertices.ptr != self.vertices.ptr:
            wp.copy(self.vertices, vertices)
        wp.copy(self._boundary.points, vertices)
        self._boundary.refit()
        self.revision += 1
        geometry = self.geometry
        geometry.mirrored_count.zero_()
        wp.launch(
            tet_frames_kernel,
            dim=len(self.tets),
            inputs=[self.tets, self.vertices, self._rest_edges, self._rest_edges_inverse],
            outputs=[
                geometry.rows,
                geometry.shapes,
                geometry.rotations,
                geometry.mirrored_count,
            ],
            device=self.device,
        )


@wp.func
def interval_in_tet(geometry: Geometry, tet: int, origin: wp.vec3, direction: wp.vec3):
    """Where a ray is inside a tet, by itself: nothing is known of its neighbours.

    Returns:
        The coordinates at t_near, where the ray is close to the tet, their slopes, t_near,
        t_in >= 0, and t_out; the ray is inside if t_out > t_in.
    """
    corner = wp.vec3(
        geometry.rows[3 * tet][3], geometry.rows[3 * tet + 1][3], geometry.rows[3 * tet + 2][3]
    )
    near = wp.dot(corner - origin, direction)
    alpha, slope = line_in_tet(geometry, tet, origin + near * direction, direction)
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
    """Where a ray leaves a tet: the distance from the point with coordinates alpha.

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
def link_across(geometry: Geometry, tet: int, face: int):
    """Across a face: 4 · tet + the face of that tet, or -1 outside."""
    link = load_wide_int(geometry.links, tet)
    return wp.where(
        face < 2, wp.where(face == 0, link[0], link[1]), wp.where(face == 2, link[2], link[3])
    )


@wp.func
def enter_mesh(geometry: Geometry, origin: wp.vec3, direction: wp.vec3, t: float):
    """The first tet at or behind t.

    A ray that meets a face from within, without having entered, started inside the mesh or
    slipped in through an edge; then the tets between t and that face are found backwards.

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
    """From a tet that a ray leaves at `end`, back to where it is at t, or entered the mesh."""
    tet = int(last_tet)
    position = float(end)
    exit_face = int(-1)
    tets_left = int(MAX_TETS)
    walking = int(1)
    while walking == 1:
        p = origin + position * direction
        alpha, slope = line_in_tet(geometry, tet, p, -direction)
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
