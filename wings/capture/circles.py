r"""Cameras that stood still while the object turned about an axis: one bundle adjustment for all.

In a ring (still.py) the object turns about one axis before one camera, so each of the ring's
photographs leaves a single number open, its angle.  A point X of the object is, seen by camera i of
ring r,

    x = L_r R_z(a_i) (A_r X + b_r) + l_r,    pixel = f (1 + k |q|²) q + c,   q = x_{1,2} / x_3

with rotations L_r, A_r, shifts l_r, b_r, and the turn R_z(a) about z.  A photograph outside of all
rings is a ring of one, with its angle fixed.  Levenberg-Marquardt minimizes the sum of
log(1 + |pixel - feature|²) over all features; points are eliminated (Triggs et al. 2000, Bundle
Adjustment - A Modern Synthesis, section 6).

So a camera of 24 has a tenth of the error that it has alone.  Whoever turns the object by hand
turns it about a new axis each time; then circles don't fit, and the cameras stay as they were.
"""

from dataclasses import dataclass, replace

import numpy as np

from .library import load_pycolmap

STEPS = 40
ENOUGH = 1e-6  # of the cost: a step that gains less is the last one
WORSE = 1.5  # times the error of free cameras: then the object was not turned about an axis
FITTED = 4  # photographs of a ring at least, whose axis can be told


@dataclass(frozen=True)
class Observed:
    """Features that show points.

    Attributes:
        cameras: The camera of each feature, a row of the cameras.  [m] int
        points: The point that it shows.  [m] int
        pixels: Where it is.  [m, 2]
        lenses: The lens of each camera.  [n] int
        centers: Of each lens [pixels].  [d, 2]
    """

    cameras: np.ndarray
    points: np.ndarray
    pixels: np.ndarray
    lenses: np.ndarray
    centers: np.ndarray


@dataclass(frozen=True)
class Rings:
    """All that is adjusted; the names are those of the module's formula.

    Attributes:
        ring: Of each camera.  [n] int
        L, A: [r, 3, 3]
        shift, b: l and b.  [r, 3]
        angle: [n]
        focal, k: Of each lens.  [d]
        points: [p, 3]
    """

    ring: np.ndarray
    L: np.ndarray
    shift: np.ndarray
    A: np.ndarray
    b: np.ndarray
    angle: np.ndarray
    focal: np.ndarray
    k: np.ndarray
    points: np.ndarray

    def cameras(self):
        """World to camera: rotations [n, 3, 3] and shifts [n, 3]."""
        left = self.L[self.ring] @ about_z(self.angle)
        shift = np.einsum("nij,nj->ni", left, self.b[self.ring]) + self.shift[self.ring]
        return left @ self.A[self.ring], shift


def about_z(angle):
    """Rotations about z.  [n] -> [n, 3, 3]"""
    turns = np.zeros((len(angle), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angle)
    turns[:, 1, 0] = np.sin(angle)
    turns[:, 0, 1] = -turns[:, 1, 0]
    turns[:, 2, 2] = 1.0
    return turns


def by_vector(vectors):
    """Rotations by rotation vectors.  [n, 3] -> [n, 3, 3]"""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vectors).as_matrix()


def cross_matrix(vectors):
    """[n, 3] -> [n, 3, 3], whose product with w is the cross product of v and w."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = ((zero, -z, y), (z, zero, -x), (-y, x, zero))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def nearest_rotation(matrix):
    u, _, v = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def first_rings(groups, turns, shifts, focal, k, points) -> Rings:
    """Rings that fit free cameras.

    Args:
        groups: The cameras of each ring, as rows; the others are rings of one.
        turns, shifts: World to camera.  [n, 3, 3], [n, 3]
    """
    count = len(turns)
    groups = [list(group) for group in groups if len(group) >= FITTED]
    groups += [[n] for n in range(count) if not any(n in group for group in groups)]
    ring, angle = np.zeros(count, int), np.zeros(count)
    L, A = np.zeros((2, len(groups), 3, 3))
    shift, b = np.zeros((2, len(groups), 3))
    for r, group in enumerate(groups):
        ring[group] = r
        if len(group) == 1:
            L[r], shift[r], A[r] = turns[group[0]], shifts[group[0]], np.eye(3)
            continue
        A[r], b[r] = axis_of(turns[group], shifts[group])
        turned = turns[group] @ A[r].T
        off = np.swapaxes(turned[:1], 1, 2) @ turned
        angle[group] = np.arctan2(off[:, 1, 0] - off[:, 0, 1], off[:, 0, 0] + off[:, 1, 1])
        back = about_z(-angle[group])
        L[r] = nearest_rotation(np.median(turned @ back, axis=0))
        at = np.einsum("ij,njk,k->ni", L[r], about_z(angle[group]), b[r])
        shift[r] = np.median(shifts[group] - at, axis=0)
    return Rings(ring, L, shift, A, b, angle, focal, k, points)


def axis_of(turns, shifts):
    """The rotation and shift that take the axis of a ring's cameras to z.  [3, 3], [3]"""
    relative = np.swapaxes(turns[:, None], 2, 3) @ turns[None]
    vectors = np.stack(
        [
            relative[..., 2, 1] - relative[..., 1, 2],
            relative[..., 0, 2] - relative[..., 2, 0],
            relative[..., 1, 0] - relative[..., 0, 1],
        ],
        axis=-1,
    ).reshape(-1, 3)
    axis = np.linalg.eigh(vectors.T @ vectors)[1][:, -1]
    across = np.linalg.svd(axis[None])[2][1]
    A = np.array([across, np.cross(axis, across), axis])
    x, y = (-np.einsum("nji,nj->ni", turns, shifts) @ A.T)[:, :2].T
    # On a circle x² + y² = 2 x x₀ + 2 y y₀ + const.
    columns = np.stack([2.0 * x, 2.0 * y, np.ones_like(x)], axis=1)
    center = np.linalg.lstsq(columns, x**2 + y**2, rcond=None)[0]
    return A, np.array([-center[0], -center[1], 0.0])


def pixels_of(rings: Rings, seen: Observed):
    """Where the points are seen.  [m, 2]"""
    turns, shifts = rings.cameras()
    x = np.einsum("nij,nj->ni", turns[seen.cameras], rings.points[seen.points])
    x += shifts[seen.cameras]
    q, lens = x[:, :2] / x[:, 2:], seen.lenses[seen.cameras]
    radial = 1.0 + rings.k[lens] * (q**2).sum(axis=1)
    return (rings.focal[lens] * radial)[:, None] * q + seen.centers[lens]


def cost(rings: Rings, seen: Observed) -> float:
    off = pixels_of(rings, seen) - seen.pixels
    value = np.log1p((off**2).sum(axis=1)).sum()
    return float(value) if np.isfinite(value) else np.inf


def blocks(rings: Rings, seen: Observed):
    """Derivatives of the pixels: of what, the first of its unknowns for each feature, the matrix.

    The last ones are the points'.
    """
    ring, lens = rings.ring[seen.cameras], seen.lenses[seen.cameras]
    count, n, d = len(rings.L), len(rings.angle), len(rings.focal)
    A, turn = rings.A[ring], about_z(rings.angle)[seen.cameras]
    AX = np.einsum("nij,nj->ni", A, rings.points[seen.points])
    turned = np.einsum("nij,nj->ni", turn, AX + rings.b[ring])
    left = np.einsum("nij,nj->ni", rings.L[ring], turned)
    x = left + rings.shift[ring]
    q, depth = x[:, :2] / x[:, 2:], x[:, 2]
    square = (q**2).sum(axis=1)
    radial, focal, k = 1.0 + rings.k[lens] * square, rings.focal[lens], rings.k[lens]
    by_q = radial[:, None, None] * np.eye(2) + 2.0 * k[:, None, None] * q[:, :, None] * q[:, None]
    by_x = np.zeros((len(x), 2, 3))
    by_x[:, 0, 0] = by_x[:, 1, 1] = 1.0 / depth
    by_x[:, :, 2] = -q / depth[:, None]
    by_x = focal[:, None, None] * by_q @ by_x
    by_y = by_x @ rings.L[ring] @ turn
    spin = np.cross([0.0, 0.0, 1.0], turned)
    by_angle = np.einsum("nij,nj->ni", by_x @ rings.L[ring], spin)[:, :, None]
    # A ring of one has no axis, and no angle.
    has_axis = (np.bincount(rings.ring)[ring] > 1)[:, None, None]
    by_angle = has_axis * by_angle
    of_axis = (has_axis * (by_y @ -cross_matrix(AX)), has_axis * by_y)
    of_ring = (by_x @ -cross_matrix(left), by_x, *of_axis)
    yield from ((12 * ring + 3 * i, matrix) for i, matrix in enumerate(of_ring))
    first = 12 * count
    yield first + seen.cameras, by_angle
    yield first + n + lens, (radial[:, None] * q)[:, :, None]
    yield first + n + d + lens, (focal * square)[:, None, None] * q[:, :, None]
    yield first + n + 2 * d + 3 * seen.points, by_y @ A


def step(rings: Rings, seen: Observed, damping: float) -> Rings:
    """One step of Levenberg-Marquardt: points eliminated, the rest solved densely."""
    from scipy.sparse import csr_array

    off = pixels_of(rings, seen) - seen.pixels
    weights = 1.0 / np.sqrt(1.0 + (off**2).sum(axis=1))
    m, p = len(off), len(rings.points)
    total = 12 * len(rings.L) + len(rings.angle) + 2 * len(rings.focal)
    rows, columns, values = [], [], []
    for first, matrix in blocks(rings, seen):
        width = matrix.shape[2]
        shape = (m, 2, width)
        row = 2 * np.arange(m)[:, None, None] + np.arange(2)[:, None]
        rows.append(np.broadcast_to(row, shape).ravel())
        columns.append(np.broadcast_to(first[:, None, None] + np.arange(width), shape).ravel())
        values.append((matrix * weights[:, None, None]).ravel())
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    jacobian = csr_array(entries, shape=(2 * m, total + 3 * p))
    cameras, points = jacobian[:, :total], jacobian[:, total:]
    residual = -(off * weights[:, None]).ravel()
    own = (cameras.T @ cameras).toarray()
    own[np.diag_indices(total)] += damping * np.maximum(own.diagonal(), 1e-9 * own.max())
    inverse = inverse_blocks(points, p, damping)
    mixed = (cameras.T @ points).tocsr()
    weighed = mixed @ inverse
    reduced = own - (weighed @ mixed.T).toarray()
    at_points = points.T @ residual
    unknown = np.linalg.solve(reduced, cameras.T @ residual - weighed @ at_points)
    moved = inverse @ (at_points - mixed.T @ unknown)
    return changed(rings, unknown, moved.reshape(p, 3))


def inverse_blocks(points, count: int, damping: float):
    """The inverse of the points' part of the normal matrix: a block of 3 x 3 each.  Sparse."""
    from scipy.sparse import bsr_array

    normal = (points.T @ points).tocoo()
    dense = np.zeros((count, 3, 3))
    rows, columns = normal.coords
    dense[rows // 3, rows % 3, columns % 3] = normal.data
    diagonal = dense[:, range(3), range(3)]
    least = 1e-9 * diagonal.max()
    dense[:, range(3), range(3)] += damping * np.maximum(diagonal, least) + least
    places = np.arange(count)
    inverse = np.linalg.inv(dense)
    return bsr_array((inverse, places, np.arange(count + 1)), shape=(3 * count,) * 2).tocsr()


def changed(rings: Rings, unknown, moved) -> Rings:
    """Rings after a step, in the order of `blocks`."""
    count, n, d = len(rings.L), len(rings.angle), len(rings.focal)
    of_ring = unknown[: 12 * count].reshape(count, 4, 3)
    angle, focal, k = np.split(unknown[12 * count :], np.cumsum([n, d]))
    return replace(
        rings,
        L=by_vector(of_ring[:, 0]) @ rings.L,
        shift=rings.shift + of_ring[:, 1],
        A=by_vector(of_ring[:, 2]) @ rings.A,
        b=rings.b + of_ring[:, 3],
        angle=rings.angle + angle,
        focal=rings.focal + focal,
        k=rings.k + k,
        points=rings.points + moved,
    )


def adjust(rings: Rings, seen: Observed, advance=lambda count: None) -> Rings:
    """Levenberg-Marquardt until a step gains hardly anything."""
    now, damping = cost(rings, seen), 1e-3
    for number in range(STEPS):
        advance(number)
        try:
            tried = step(rings, seen, damping)
            then = cost(tried, seen)
        except np.linalg.LinAlgError:
            then = np.inf
        if then < now:
            gained, rings, now = now - then, tried, then
            damping = max(damping / 5.0, 1e-9)
            if gained < ENOUGH * now:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    advance(STEPS)
    return rings


def on_circles(found, groups, numbers, advance=lambda count: None) -> bool:
    """Adjust the cameras of one of pycolmap's reconstructions, if they fit on circles.

    Args:
        found: The reconstruction, which is changed.
        groups: The photographs of each ring, by number.
        numbers: The photograph of each of its images, by their ids.

    Returns:
        Whether they do.
    """
    images = sorted(found.reg_image_ids(), key=numbers.get)
    rows = {numbers[key]: row for row, key in enumerate(images)}
    groups = [[rows[n] for n in group if n in rows] for group in groups]
    if not any(len(group) >= FITTED for group in groups):
        return False
    seen, points = seen_in(found, images)
    lenses = sorted({found.images[key].camera_id for key in images})
    focal, k = np.array([found.cameras[key].params[[0, 3]] for key in lenses]).T
    matrices = np.array([found.images[key].cam_from_world().matrix() for key in images])
    turns, shifts = matrices[:, :, :3], matrices[:, :, 3]
    free = first_rings([], turns, shifts, focal, k, points)
    rings = adjust(first_rings(groups, turns, shifts, focal, k, points), seen, advance)
    errors = [
        np.median(np.linalg.norm(pixels_of(r, seen) - seen.pixels, axis=1)) for r in (free, rings)
    ]
    if not errors[1] < WORSE * errors[0]:
        return False
    put_back(found, images, lenses, rings)
    return True


def seen_in(found, images):
    """The features of a reconstruction's images that show points, and these points [p, 3]."""
    rows = {key: row for row, key in enumerate(found.points3D)}
    lenses = sorted({found.images[key].camera_id for key in images})
    cameras, points, pixels = [], [], []
    for row, key in enumerate(images):
        shown = [p for p in found.images[key].points2D if p.has_point3D()]
        cameras += [row] * len(shown)
        points += [rows[p.point3D_id] for p in shown]
        pixels += [p.xy for p in shown]
    return Observed(
        np.array(cameras),
        np.array(points),
        np.array(pixels).reshape(-1, 2),
        np.array([lenses.index(found.images[key].camera_id) for key in images]),
        np.array([found.cameras[key].params[1:3] for key in lenses]),
    ), np.array([point.xyz for point in found.points3D.values()])


def put_back(found, images, lenses, rings: Rings):
    """Write cameras, lenses and points into a reconstruction."""
    pycolmap = load_pycolmap()
    for key, focal, k in zip(lenses, rings.focal, rings.k, strict=True):
        params = np.array(found.cameras[key].params)
        params[[0, 3]] = focal, k
        found.cameras[key].params = params
    for key, turn, shift in zip(images, *rings.cameras(), strict=True):
        pose = pycolmap.Rigid3d(np.concatenate([turn, shift[:, None]], axis=1))
        image = found.images[key]
        image.frame.set_cam_from_world(image.camera_id, pose)
    for point, place in zip(found.points3D.values(), rings.points, strict=True):
        point.xyz = place
    found.update_point_3d_errors()
