"""The mesh in its current shape, and what rays need to know about each tet.

For each pose, each tet k gets:

    alpha(p)                     barycentric coordinates of a current point, linear in p
    |F_k^-1 d|                   rest length per t, from how alpha changes along d
    Q_k                          orthogonal polar factor of F_k, reflection kept
    s_k                          smoothstep(1e-3, 1e-2, σ_min/σ_max of F_k): flat tets fade

Shapes: T tets, V vertices, B boundary faces.  Model units.
"""

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from ...base.recorded import Recorded
from ...base.threads import counted, shares_of
from ...geometry import TetMesh, boundary_faces

# Rounding may move a face across a ray's t: queries look this far around t, boxes are this
# much larger than what is in them.
QUERY_GAP = wp.constant(4.0e-6)
# A tet flatter than this (σ_min/σ_max) has no coordinates.  Rays that meet a fading tet are
# tangled (overlap/search.py).  A walk meets a flat one by rounding only, and ends there.
FLAT = wp.constant(1.0e-5)
TETS_PER_THREAD = 500  # of a CPU, at least: 0.2 ms
FITTED_TREE = "sah"  # the host builds it once; rays find their way faster than in a GPU's own
FADED = wp.constant(1.0e-3)  # σ_min/σ_max where a tet has faded out
# Newton's iteration for the polar factor: 6 steps take any stretches with σ_min/σ_max >= FADED
# to 1e-10; tests/core/render/rays/test_traversal.py holds rotations to 0.02 degrees.
POLAR_STEPS = 6

wp.set_module_options({"enable_backward": False, "max_unroll": 4})


@wp.struct
class Geometry:
    """What rays march through, on a device: the mesh, refreshed per pose, and where it is dense.

    A tet has three `rows`, the gradients of its last three coordinates, each followed by a
    component of its corner 0, the point that they are counted from: thin tets have large
    gradients, and an offset from the origin would then have a large rounding error.  And it
    has two `shapes`, products of its edges at rest, e_i · e_j, those of different edges
    doubled: (11, 22, 33, 12) and (13, 23, s, sign), where sign is -1 if the tet is mirrored.
    """

    vertices: wp.array(dtype=wp.vec3)  # [V] current
    faces: wp.array(dtype=wp.vec3i)  # [B] of the boundary
    boundary: wp.uint64  # id of the wp.Mesh of boundary faces
    face_boxes: wp.uint64  # id of a BVH of them, see Pose.refresh_face_boxes
    boundary_tets: wp.array(dtype=int)  # [B] the tet behind each face
    links: wp.array(dtype=wp.vec4i)  # [T] across each face: 4 · tet + its face, -1 outside
    rows: wp.array(dtype=wp.vec4)  # [3 T]
    shapes: wp.array(dtype=wp.vec4)  # [2 T]
    rotations: wp.array(dtype=wp.mat33)  # [T]
    mirrored_count: wp.array(dtype=int)  # [1]
    # Set by the owner of the pose:
    occupancy: wp.array(dtype=wp.uint64)  # [T] masks of the sub-tets that can hold density
    densities: wp.array(dtype=float)  # [64 T] σ that is expected in sub-tets, on a CPU alone
    step: float  # Δ, the rest length of a piece


def links(neighbours):
    """`Geometry.links` from the neighbors of each tet.  [T, 4] -> [T, 4] int32"""
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


@wp.func
def largest_stretch_squared(norm: wp.float64, areas: wp.float64, volume: wp.float64):
    """σ1² of F, the largest root of x³ - norm x² + areas x - volume², by the cosine of a third of
    an angle (Smith, "Eigenvalues of a symmetric 3×3 matrix", CACM 1961)."""
    third = norm / wp.float64(3.0)
    spread = third * third - areas / wp.float64(3.0)  # p² of Smith
    if spread <= wp.float64(1.0e-30) * third * third:
        return third
    p = wp.sqrt(spread)
    q = third * third * third - wp.float64(0.5) * third * areas
    q += wp.float64(0.5) * volume * volume
    cosine = wp.clamp(q / (spread * p), wp.float64(-1.0), wp.float64(1.0))
    return third + wp.float64(2.0) * p * wp.cos(wp.acos(cosine) / wp.float64(3.0))


@wp.func
def stretch_ratio(f: wp.mat33d):
    """σ_min/σ_max of F.

    The largest is found first; det F and the areas of F's columns then give (σ2 σ3)² and
    σ2² + σ3², so the small ones are not lost beside it.
    """
    a = wp.vec3d(f[0, 0], f[1, 0], f[2, 0])
    b = wp.vec3d(f[0, 1], f[1, 1], f[2, 1])
    c = wp.vec3d(f[0, 2], f[1, 2], f[2, 2])
    norm = wp.length_sq(a) + wp.length_sq(b) + wp.length_sq(c)
    areas = (
        wp.length_sq(wp.cross(a, b)) + wp.length_sq(wp.cross(b, c)) + wp.length_sq(wp.cross(c, a))
    )
    volume = wp.determinant(f)
    first = largest_stretch_squared(norm, areas, volume)
    first = wp.clamp(first, norm / wp.float64(3.0), norm)
    product = volume * volume / first
    total = (areas - product) / first
    root = wp.sqrt(wp.max(total * total - wp.float64(4.0) * product, wp.float64(0.0)))
    second = wp.float64(0.5) * (total + root)
    ratio = wp.sqrt(product / second / first)
    return wp.where(second > wp.float64(0.0), wp.min(float(ratio), 1.0), 0.0)


@wp.func
def polar_factor(f: wp.mat33d):
    """The orthogonal factor Q of F = Q S, S positive; it reflects where det F < 0.

    X ← ½ (γ X + X⁻ᵀ/γ), γ² = |X⁻¹|/|X| (Higham, "Computing the polar decomposition", 1986).
    """
    x = f
    for _ in range(POLAR_STEPS):
        r0 = wp.vec3d(x[0, 0], x[0, 1], x[0, 2])
        r1 = wp.vec3d(x[1, 0], x[1, 1], x[1, 2])
        r2 = wp.vec3d(x[2, 0], x[2, 1], x[2, 2])
        cofactors = wp.matrix_from_rows(wp.cross(r1, r2), wp.cross(r2, r0), wp.cross(r0, r1))
        inverse = cofactors / wp.dot(r0, wp.cross(r1, r2))  # X⁻ᵀ
        gamma = wp.sqrt(wp.sqrt(wp.ddot(inverse, inverse) / wp.ddot(x, x)))
        x = wp.float64(0.5) * (gamma * x + inverse / gamma)
    return x


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
    # All of it is float64: in float32 the coordinates of a thin tet would be off by its thickness,
    # and the polar factor of a long one by degrees.
    x0d = wp.vec3d(x0)
    current = wp.matrix_from_cols(
        wp.vec3d(vertices[tet[1]]) - x0d,
        wp.vec3d(vertices[tet[2]]) - x0d,
        wp.vec3d(vertices[tet[3]]) - x0d,
    )
    volume = wp.determinant(current)
    f = current * wp.mat33d(rest_edges_inverse[i])
    ratio = stretch_ratio(f)
    fade = smoothstep(FADED, 1.0e-2, ratio)
    if fade > 0.0:
        rotations[i] = wp.mat33(polar_factor(f))
    else:  # it has no density, and a direction that is finite
        rotations[i] = wp.identity(n=3, dtype=float)
    m = wp.mat33d()
    if ratio > FLAT:  # rays cross a faded tet, though it has no density
        m = wp.inverse(current)
    for k in range(3):
        rows[3 * i + k] = wp.vec4(float(m[k, 0]), float(m[k, 1]), float(m[k, 2]), x0[k])
    gram = wp.transpose(rest_edges[i]) * rest_edges[i]
    sign = wp.where(volume < wp.float64(0.0), -1.0, 1.0)
    shapes[2 * i] = wp.vec4(gram[0, 0], gram[1, 1], gram[2, 2], 2.0 * gram[0, 1])
    shapes[2 * i + 1] = wp.vec4(2.0 * gram[0, 2], 2.0 * gram[1, 2], fade, sign)
    if sign < 0.0:
        wp.atomic_add(mirrored_count, 0, 1)


@wp.kernel
def boxes_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V]
    groups: wp.array(dtype=wp.vec4i),  # of vertices: tets, or faces with one corner twice
    ids: wp.array(dtype=int),  # group of each thread; if empty, thread i has group i
    lowers: wp.array(dtype=wp.vec3),  # [threads] out
    uppers: wp.array(dtype=wp.vec3),  # [threads] out
):
    i = wp.tid()
    n = i
    if ids.shape[0] > 0:
        n = ids[i]
    group = groups[n]
    a = vertices[group[0]]
    b = vertices[group[1]]
    c = vertices[group[2]]
    d = vertices[group[3]]
    gap = wp.vec3(QUERY_GAP, QUERY_GAP, QUERY_GAP)  # a ray in the plane of a flat box meets it
    lowers[i] = wp.min(wp.min(a, b), wp.min(c, d)) - gap
    uppers[i] = wp.max(wp.max(a, b), wp.max(c, d)) + gap


def box_tree(vertices, groups, ids=None, old: wp.Bvh | None = None, constructor=None) -> wp.Bvh:
    """A BVH of the boxes of groups of vertices, see `boxes_kernel`; `old` is refitted."""
    device = vertices.device
    ids = wp.empty(0, dtype=int, device=device) if ids is None else ids
    count = len(ids) or len(groups)
    if old is None:
        boxes = [wp.empty(count, dtype=wp.vec3, device=device) for _ in range(2)]
    else:
        boxes = [old.lowers, old.uppers]
    wp.launch(boxes_kernel, count, inputs=[vertices, groups, ids], outputs=boxes, device=device)
    if old is None:
        return wp.Bvh(*boxes, constructor=constructor)
    old.refit()
    return old


def _on_host(vertices) -> np.ndarray:
    """Positions of any kind.  [n, 3] float32

    Raises:
        ValueError: They have another shape or no finite numbers, or torch would want gradients.
    """
    if isinstance(vertices, wp.array):
        vertices = vertices.numpy()
    elif hasattr(vertices, "requires_grad"):  # a torch tensor
        if vertices.requires_grad:
            raise ValueError(
                "the vertices are a tensor that requires gradients, and rendering has none: "
                "pass vertices.detach()"
            )
        vertices = vertices.float().cpu().numpy()
    vertices = np.ascontiguousarray(vertices, np.float32)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"the vertices have the shape {list(vertices.shape)}, not [V, 3]")
    if not np.isfinite(vertices).all():
        raise ValueError("some vertices are no finite numbers")
    return vertices


class Pose:
    """The mesh in its current shape on one device: `geometry` for kernels, and its arrays.

    `boundary_faces` are vertex ids, in NumPy [B, 3]; `revision` counts changes of the vertices.

    Raises:
        ValueError: The mesh has no boundary.
    """

    def __init__(self, mesh: TetMesh, neighbours: np.ndarray, device: wp.Device):
        self.device = wp.get_device(device)
        faces, behind = boundary_faces(mesh.tets, neighbours)
        if len(faces) == 0:  # Warp ends the process when it refits an empty mesh
            raise ValueError("the mesh has no boundary, so no ray can enter it")
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
                points=wp.clone(self.vertices),
                indices=wp.array(faces.ravel(), dtype=int),
                bvh_constructor=FITTED_TREE,
            )
            self._face_boxes, self._face_boxes_revision = None, 0
            self._face_corners = wp.array(faces[:, [0, 1, 2, 2]], dtype=wp.vec4i)
            geometry = self.geometry = Geometry()
            geometry.vertices = self.vertices
            geometry.faces = wp.array(faces, dtype=wp.vec3i)
            geometry.boundary = self._boundary.id
            geometry.boundary_tets = wp.array(behind, dtype=int)
            geometry.links = wp.array(links(neighbours), dtype=wp.vec4i)
            geometry.rows = wp.empty(3 * mesh.tet_count, dtype=wp.vec4)
            geometry.shapes = wp.empty(2 * mesh.tet_count, dtype=wp.vec4)
            geometry.rotations = wp.empty(mesh.tet_count, dtype=wp.mat33)
            geometry.mirrored_count = wp.zeros(1, dtype=int)
        self._following, self._fitting = Recorded(self.device), Recorded(self.device)
        self._frame_launches = None  # on a CPU: each with what it adds to mirrored_count
        self.set_vertices(self.vertices)

    def set_vertices(self, vertices: ArrayLike | wp.array) -> None:
        """Take new positions [V, 3]; Renderer.set_vertices says of what kinds."""
        if not (isinstance(vertices, wp.array) and vertices.dtype is wp.vec3):
            vertices = wp.array(_on_host(vertices), dtype=wp.vec3, device=self.device)
        if vertices.shape != self.vertices.shape:
            raise ValueError(
                f"the mesh has {len(self.vertices)} vertices, {len(vertices)} were given"
            )
        vertices = vertices.to(self.device)
        if vertices.ptr != self.vertices.ptr:
            wp.copy(self.vertices, vertices)
        self.revision += 1
        self._following(self._fit)

    def _fit(self):
        """Bring the boundary and the tets' frames to the vertices."""
        wp.copy(self._boundary.points, self.vertices)
        self._boundary.refit()
        if self.device.is_cpu:
            self._fit_frames_on_cpu()
            return
        self.geometry.mirrored_count.zero_()
        inputs, frames = self._frame_arrays(0, len(self.tets), self.geometry.mirrored_count)
        wp.launch(tet_frames_kernel, len(self.tets), inputs, frames, device=self.device)

    def _fit_frames_on_cpu(self):
        """Launch for some tets in each thread."""
        if self._frame_launches is None:
            launches = []
            for first, end in shares_of(len(self.tets), TETS_PER_THREAD):
                mirrored = wp.zeros(1, dtype=int, device="cpu")
                arrays = self._frame_arrays(first, end, mirrored)
                launch = wp.launch(
                    tet_frames_kernel, end - first, *arrays, device="cpu", record_cmd=True
                )
                launches.append((launch, mirrored.numpy()))
            self._frame_launches = launches
        self.geometry.mirrored_count.numpy()[:] = counted(self._frame_launches)

    def _frame_arrays(self, first, end, mirrored_count):
        """Inputs and outputs of tet_frames_kernel for some tets."""
        geometry, span = self.geometry, slice(first, end)
        inputs = [self.tets[span], self.vertices]
        inputs += [self._rest_edges[span], self._rest_edges_inverse[span]]
        frames = [geometry.rows[3 * first : 3 * end], geometry.shapes[2 * first : 2 * end]]
        return inputs, [*frames, geometry.rotations[span], mirrored_count]

    def refresh_face_boxes(self) -> None:
        """Bring the BVH `geometry.face_boxes` up to date; only some paths of rendering need it."""
        if self._face_boxes_revision != self.revision:
            self._fitting(self._fit_face_boxes)
            self._face_boxes_revision = self.revision

    def _fit_face_boxes(self):
        corners, old = self._face_corners, self._face_boxes
        self._face_boxes = box_tree(self.vertices, corners, old=old, constructor=FITTED_TREE)
        self.geometry.face_boxes = self._face_boxes.id
