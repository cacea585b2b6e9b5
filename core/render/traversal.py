"""Where a ray goes through the deformed mesh.

Per pose, each tet k gets a frame:

    alpha(p) = G_k p + g_k       barycentric coordinates of a current point
    F_k^-1                       current to rest directions; |F_k^-1 d| is rest length per t
    Q_k                          orthogonal polar factor of F_k, reflection kept
    s_k                          smoothstep(1e-3, 1e-2, σ_min/σ_max of F_k): flat tets fade

A ray enters through the boundary mesh (a BVH refitted per pose) and then walks across
faces; within a tet alpha(t) is linear, so the exit is where the first coordinate that
falls reaches zero.

Shapes: T tets, V vertices, B boundary faces.  Model units.
"""

import numpy as np
import warp as wp

from ..geometry.mesh import TetMesh, boundary_faces

# A boundary query looks this far around t for faces that rounding has moved across it.
QUERY_GAP = wp.constant(4.0e-6)
# Two units of the last place of t per face: a ray through an edge or a vertex, where
# rounding makes the tets around it disagree, is carried past it instead of circling.
SMALLEST_ADVANCE = wp.constant(2.4e-7)
FADED = wp.constant(1.0)  # a smaller fade s: a tet so flat that it isn't fully there
# A tet flatter than this (σ_min/σ_max) is a wall without thickness: rays jump over it.
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
    gradients: wp.array(dtype=wp.mat44),  # [T] out
    rest_from_current: wp.array(dtype=wp.mat33),  # [T] out, F^-1
    rotations: wp.array(dtype=wp.mat33),  # [T] out, Q
    fades: wp.array(dtype=float),  # [T] out, s
    signs: wp.array(dtype=float),  # [T] out, ±1: -1 if the tet is mirrored
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
    largest = wp.max(wp.abs(stretches))
    smallest = wp.min(wp.abs(stretches))
    ratio = smallest / wp.max(largest, 1.0e-30)
    fade = smoothstep(1.0e-3, 1.0e-2, ratio)
    g = wp.mat44()
    inverse_f = wp.mat33()
    if ratio > FLAT:  # a faded tet has no density, but rays still have to cross it
        m = wp.inverse(edges)
        o = -(m * x0)
        g = wp.mat44(
            -m[0, 0] - m[1, 0] - m[2, 0],
            -m[0, 1] - m[1, 1] - m[2, 1],
            -m[0, 2] - m[1, 2] - m[2, 2],
            1.0 - o[0] - o[1] - o[2],
            m[0, 0],
            m[0, 1],
            m[0, 2],
            o[0],
            m[1, 0],
            m[1, 1],
            m[1, 2],
            o[1],
            m[2, 0],
            m[2, 1],
            m[2, 2],
            o[2],
        )
        inverse_f = rest_edges[i] * m
    gradients[i] = g
    rest_from_current[i] = inverse_f
    fades[i] = fade
    sign = wp.where(wp.determinant(f) < 0.0, -1.0, 1.0)
    signs[i] = sign
    if sign < 0.0:
        wp.atomic_add(mirrored_count, 0, 1)


@wp.struct
class Geometry:
    """What a walk needs; one per device, refreshed per pose."""

    boundary: wp.uint64  # id of the wp.Mesh of boundary faces
    boundary_tets: wp.array(dtype=int)  # [B] the tet behind each face
    neighbours: wp.array(dtype=wp.vec4i)  # [T]
    gradients: wp.array(dtype=wp.mat44)  # [T]
    rest_from_current: wp.array(dtype=wp.mat33)  # [T]
    rotations: wp.array(dtype=wp.mat33)  # [T]
    fades: wp.array(dtype=float)  # [T]
    signs: wp.array(dtype=float)  # [T]
    mirrored_count: wp.array(dtype=int)  # [1]


@wp.func
def orientation(geometry: Geometry):
    """1, or -1 if most tets are mirrored: then the boundary's normals point inwards."""
    return wp.where(2 * geometry.mirrored_count[0] > geometry.signs.shape[0], -1.0, 1.0)


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
            geometry.neighbours = wp.array(neighbours, dtype=wp.vec4i)
            geometry.gradients = wp.empty(mesh.tet_count, dtype=wp.mat44)
            geometry.rest_from_current = wp.empty(mesh.tet_count, dtype=wp.mat33)
            geometry.rotations = wp.empty(mesh.tet_count, dtype=wp.mat33)
            geometry.fades = wp.empty(mesh.tet_count, dtype=float)
            geometry.signs = wp.empty(mesh.tet_count, dtype=float)
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
                geometry.gradients,
                geometry.rest_from_current,
                geometry.rotations,
                geometry.fades,
                geometry.signs,
                geometry.mirrored_count,
            ],
            device=self.device,
        )


@wp.func
def interval_in_tet(geometry: Geometry, tet: int, origin: wp.vec3, direction: wp.vec3):
    """Where a ray is inside a tet, by itself: nothing is known of its neighbours.

    Returns:
        The coordinates at t = 0, their slopes, and t_in >= 0 and t_out; the ray is inside
        if t_out > t_in.
    """
    g = geometry.gradients[tet]
    alpha = g * wp.vec4(origin[0], origin[1], origin[2], 1.0)
    slope = g * wp.vec4(direction[0], direction[1], direction[2], 0.0)
    t_in = float(0.0)
    t_out = float(1.0e30)
    i = int(0)
    while i < 4:
        if slope[i] > 0.0:
            t_in = wp.max(t_in, -alpha[i] / slope[i])
        elif slope[i] < 0.0:
            t_out = wp.min(t_out, -alpha[i] / slope[i])
        elif alpha[i] < 0.0:
            t_out = -1.0
        i += 1
    return alpha, slope, t_in, t_out


@wp.func
def exit_tet(alpha: wp.vec4, slope: wp.vec4, entry_face: int):
    """Where a ray leaves a tet: the distance from the point with coordinates alpha.

    Returns:
        The face, or -1 if no coordinate falls (a flat tet), and the distance (>= 0).
    """
    face = int(-1)
    distance = float(1.0e30)
    i = int(0)
    while i < 4:
        if i != entry_face and slope[i] < 0.0:
            d = -alpha[i] / slope[i]
            if d < distance:
                distance = d
                face = i
        i += 1
    return face, wp.max(distance, 0.0)


@wp.func
def face_towards(neighbours: wp.vec4i, tet: int):
    """The face of a tet (given by its neighbours) behind which `tet` lies."""
    face = int(3)
    if neighbours[0] == tet:
        face = 0
    if neighbours[1] == tet:
        face = 1
    if neighbours[2] == tet:
        face = 2
    return face


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
        g = geometry.gradients[tet]
        p = origin + position * direction
        alpha = g * wp.vec4(p[0], p[1], p[2], 1.0)
        slope = -(g * wp.vec4(direction[0], direction[1], direction[2], 0.0))
        face, distance = exit_tet(alpha, slope, exit_face)
        walking = 0
        previous = int(-1)
        if face < 0:
            previous = across_flat_tet(geometry, tet, exit_face, p, -direction)
        else:
            position -= wp.max(distance, SMALLEST_ADVANCE * wp.max(position, 1.0))
            previous = geometry.neighbours[tet][face]
        if position > t and tets_left > 0 and previous >= 0:
            exit_face = face_towards(geometry.neighbours[previous], tet)
            tet = previous
            tets_left -= 1
            walking = 1
    return tet, wp.max(position, t)


@wp.func
def across_flat_tet(
    geometry: Geometry, tet: int, entry_face: int, point: wp.vec3, direction: wp.vec3
):
    """The neighbour of a tet without thickness that holds the ray right behind it, or -1."""
    p = point + QUERY_GAP * direction
    best = int(-1)
    best_inside = float(-1.0e-3)
    i = int(0)
    while i < 4:
        other = geometry.neighbours[tet][i]
        if i != entry_face and other >= 0:
            alpha = geometry.gradients[other] * wp.vec4(p[0], p[1], p[2], 1.0)
            if wp.min(alpha) > best_inside:
                best_inside = wp.min(alpha)
                best = other
        i += 1
    return best
