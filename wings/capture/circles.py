r"""Cameras that stood still while the object turned about an axis: one bundle adjustment for all.

In a ring (still.py) the object turns about one axis before one camera, so each of the ring's
photographs leaves a single number open, its angle.  A point X of the object is, seen by camera i of
ring r,

    x = L_r R_z(a_i) (A_s X + b_s) + l_r,    pixel = f (1 + k |q|²) q + c,   q = x_{1,2} / x_3

with rotations L_r, A_s, shifts l_r, b_s, and the turn R_z(a) about z.  The stand s says how the
object stands on what turns: stand 0 is fixed, A_0 = I, b_0 = 0, without a turn.  A photograph
outside of all rings is a ring of one, on stand 0.  Levenberg-Marquardt minimizes the sum of
log(1 + |w (pixel - feature)|²) over all features; points are eliminated (Triggs et al. 2000, Bundle
Adjustment - A Modern Synthesis, section 6).  The weight w falls with the feature's scale, as its
exactness does.

So a camera of 24 has a tenth of the error that it has alone.  Whoever turns the object by hand
turns it about a new axis each time; then circles don't fit, and the cameras stay as they were.

An object that fills a small part of the photographs tells little of the lens, and a lens that is
off tilts the cameras.  If the object keeps its stand from ring to ring, what stands still tells
more: each ring has one more camera, on stand 0, that sees the background.
"""

from dataclasses import dataclass, replace

import numpy as np

from .features import LEAST_MATCHES
from .library import load_pycolmap
from .still import Still

STEPS = 40
ENOUGH = 1e-6  # of the cost: a step that gains less is the last one
WORSE = 1.5  # times the error of free cameras: then the object was not turned about an axis
SAME_STAND = 1.1  # times the error of rings with axes of their own: the object kept its stand
UNDISTORTIONS = 10  # steps of a fixed point
FITTED = 4  # photographs of a ring at least, whose axis can be told


@dataclass(frozen=True)
class Observed:
    """Features that show points.

    Attributes:
        cameras: The camera of each feature, a row of the cameras.  [m] int
        points: The point that it shows.  [m] int
        pixels: Where it is.  [m, 2]
        weights: How exact that is; 1 at their median.  [m]
        lenses: The lens of each camera.  [n] int
        centers: Of each lens [pixels].  [d, 2]
    """

    cameras: np.ndarray
    points: np.ndarray
    pixels: np.ndarray
    weights: np.ndarray
    lenses: np.ndarray
    centers: np.ndarray


@dataclass(frozen=True)
class Rings:
    """All that is adjusted; the names are those of the module's formula.

    Attributes:
        ring, stand: Of each camera.  [n] int
        L, shift: L and l of each ring.  [r, 3, 3], [r, 3]
        A, b: Of each stand; of the first they are fixed.  [s, 3, 3], [s, 3]
        angle: [n]
        focal, k: Of each lens.  [d]
        points: [p, 3]
    """

    ring: np.ndarray
    stand: np.ndarray
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
        shift = np.einsum("nij,nj->ni", left, self.b[self.stand]) + self.shift[self.ring]
        return left @ self.A[self.stand], shift


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


def first_rings(groups, turns, shifts, focal, k, points, one_stand=False) -> Rings:
    """Rings that fit free cameras.

    Args:
        groups: The cameras of each ring, as rows; the others are rings of one.
        turns, shifts: World to camera.  [n, 3, 3], [n, 3]
        one_stand: Whether the object stands in all rings as in the longest one.
    """
    count = len(turns)
    groups = [list(group) for group in groups if len(group) >= FITTED]
    longest = max(groups, key=len, default=None)
    groups += [[n] for n in range(count) if not any(n in group for group in groups)]
    ring, stand = np.zeros((2, count), int)
    angle, L, shift = np.zeros(count), np.zeros((len(groups), 3, 3)), np.zeros((len(groups), 3))
    A, b = [np.eye(3)], [np.zeros(3)]
    for r, group in enumerate(groups):
        ring[group] = r
        if len(group) == 1:
            L[r], shift[r] = turns[group[0]], shifts[group[0]]
            continue
        if len(A) == 1 or not one_stand:
            of = longest if one_stand else group
            for values, value in zip((A, b), axis_of(turns[of], shifts[of]), strict=True):
                values.append(value)
        stand[group] = len(A) - 1
        turned = turns[group] @ A[-1].T
        off = np.swapaxes(turned[:1], 1, 2) @ turned
        angle[group] = np.arctan2(off[:, 1, 0] - off[:, 0, 1], off[:, 0, 0] + off[:, 1, 1])
        back = about_z(-angle[group])
        L[r] = nearest_rotation(np.median(turned @ back, axis=0))
        at = np.einsum("ij,njk,k->ni", L[r], about_z(angle[group]), b[-1])
        shift[r] = np.median(shifts[group] - at, axis=0)
    return Rings(ring, stand, L, shift, np.array(A), np.array(b), angle, focal, k, points)


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
    off = seen.weights[:, None] * (pixels_of(rings, seen) - seen.pixels)
    value = np.log1p((off**2).sum(axis=1)).sum()
    return float(value) if np.isfinite(value) else np.inf


def blocks(rings: Rings, seen: Observed):
    """Derivatives of the pixels: of what, the first of its unknowns for each feature, the matrix.

    The last ones are the points'.
    """
    ring, stand, lens = (a[seen.cameras] for a in (rings.ring, rings.stand, seen.lenses))
    n, d = len(rings.angle), len(rings.focal)
    A, turn = rings.A[stand], about_z(rings.angle)[seen.cameras]
    AX = np.einsum("nij,nj->ni", A, rings.points[seen.points])
    turned = np.einsum("nij,nj->ni", turn, AX + rings.b[stand])
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
    turns = (stand > 0)[:, None, None]
    yield 6 * ring, by_x @ -cross_matrix(left)
    yield 6 * ring + 3, by_x
    first = 6 * len(rings.L)
    yield first + 6 * stand, turns * (by_y @ -cross_matrix(AX))
    yield first + 6 * stand + 3, turns * by_y
    first += 6 * len(rings.A)
    yield first + seen.cameras, turns * by_angle
    yield first + n + lens, (radial[:, None] * q)[:, :, None]
    yield first + n + d + lens, (focal * square)[:, None, None] * q[:, :, None]
    yield first + n + 2 * d + 3 * seen.points, by_y @ A


def step(rings: Rings, seen: Observed, damping: float) -> Rings:
    """One step of Levenberg-Marquardt: points eliminated, the rest solved densely."""
    from scipy.sparse import csr_array

    off = pixels_of(rings, seen) - seen.pixels
    weights = seen.weights / np.sqrt(1.0 + ((seen.weights[:, None] * off) ** 2).sum(axis=1))
    m, p = len(off), len(rings.points)
    total = 6 * len(rings.L) + 6 * len(rings.A) + len(rings.angle) + 2 * len(rings.focal)
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
    lengths = 6 * len(rings.L), 6 * len(rings.A), len(rings.angle), len(rings.focal)
    of_rings, of_stands, angle, focal, k = np.split(unknown, np.cumsum(lengths))
    of_rings, of_stands = of_rings.reshape(-1, 2, 3), of_stands.reshape(-1, 2, 3)
    return replace(
        rings,
        L=by_vector(of_rings[:, 0]) @ rings.L,
        shift=rings.shift + of_rings[:, 1],
        A=by_vector(of_stands[:, 0]) @ rings.A,
        b=rings.b + of_stands[:, 1],
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


def on_circles(found, groups, numbers, scales, still=None, advance=lambda count: None) -> bool:
    """Adjust the cameras of one of pycolmap's reconstructions, if they fit on circles.

    Args:
        found: The reconstruction, which is changed.
        groups: The photographs of each ring, by number.
        numbers: The photograph of each of its images, by their ids.
        scales: By the photograph's number, those of its features [pixels].
        still: What stands still behind the rings, if anything is known of it.

    Returns:
        Whether they do.
    """
    images = sorted(found.reg_image_ids(), key=numbers.get)
    rows = {numbers[key]: row for row, key in enumerate(images)}
    places = [[rows[n] for n in group if n in rows] for group in groups]
    fitted = [r for r, group in enumerate(places) if len(group) >= FITTED]
    if not fitted:
        return False
    seen, points = seen_in(found, images, [scales[numbers[key]] for key in images])
    lenses = sorted({found.images[key].camera_id for key in images})
    focal, k = np.array([found.cameras[key].params[[0, 3]] for key in lenses]).T
    matrices = np.array([found.images[key].cam_from_world().matrix() for key in images])
    free = matrices[:, :, :3], matrices[:, :, 3], focal, k, points
    rings = adjust(first_rings(places, *free), seen, advance)
    if not error(rings, seen) < WORSE * error(first_rings([], *free), seen):
        return False
    shared = still is not None and np.isin(still.rings, fitted).all(axis=1)
    if np.count_nonzero(shared) >= LEAST_MATCHES:
        before = *rings.cameras(), rings.focal, rings.k, rings.points
        one = first_rings(places, *before, one_stand=True)
        one = adjust(one, seen, lambda count: advance(STEPS + count))
        numbered = np.searchsorted(fitted, still.rings[shared])
        behind = Still(numbered, still.pixels[shared], still.scales[shared])
        both = with_background(one, seen, behind)
        joined = adjust(*both, lambda count: advance(2 * STEPS + count))
        rings = without_background(joined, rings, seen)
    advance(3 * STEPS)
    put_back(found, images, lenses, rings)
    return True


def error(rings: Rings, seen: Observed) -> float:
    """The median distance of features from where their points are seen [pixels]."""
    return float(np.median(np.linalg.norm(pixels_of(rings, seen) - seen.pixels, axis=1)))


def with_background(rings: Rings, seen: Observed, still: Still):
    """Rings with one more camera for each that has an axis, and what these see of the background.

    Args:
        still: It numbers the rings as they are here.
    """
    pairs, pixels, scales = still.rings, still.pixels, still.scales
    count = len(np.unique(rings.ring[rings.stand > 0]))
    lens = seen.lenses[[np.flatnonzero(rings.ring == r)[0] for r in range(count)]]
    origins, directions = np.zeros((2, len(pairs), 2, 3))
    for side in range(2):
        r = pairs[:, side]
        q = (pixels[:, side] - seen.centers[lens[r]]) / rings.focal[lens[r], None]
        away = np.concatenate([without_distortion(q, rings.k[lens[r]]), np.ones((len(q), 1))], 1)
        directions[:, side] = np.einsum("nji,nj->ni", rings.L[r], away)
        origins[:, side] = -np.einsum("nji,nj->ni", rings.L[r], rings.shift[r])
    points, ahead = nearest_to_rays(origins, directions)
    more = replace(
        rings,
        ring=np.concatenate([rings.ring, np.arange(count)]),
        stand=np.concatenate([rings.stand, np.zeros(count, int)]),
        angle=np.concatenate([rings.angle, np.zeros(count)]),
        points=np.concatenate([rings.points, points[ahead]]),
    )
    place = len(rings.points) + np.repeat(np.arange(np.count_nonzero(ahead)), 2)
    return more, Observed(
        np.concatenate([seen.cameras, len(rings.ring) + pairs[ahead].ravel()]),
        np.concatenate([seen.points, place]),
        np.concatenate([seen.pixels, pixels[ahead].reshape(-1, 2)]),
        np.concatenate([seen.weights, np.median(scales) / scales[ahead].ravel()]),
        np.concatenate([seen.lenses, lens]),
        seen.centers,
    )


def without_background(joined: Rings, alone: Rings, seen: Observed) -> Rings:
    """The rings of before, adjusted with the background; or alone, if the object was set anew."""
    count, points = len(alone.ring), len(alone.points)
    found = replace(
        joined,
        ring=joined.ring[:count],
        stand=joined.stand[:count],
        angle=joined.angle[:count],
        points=joined.points[:points],
    )
    return found if error(found, seen) < SAME_STAND * error(alone, seen) else alone


def without_distortion(q, k):
    """Where rays are seen without distortion.  [n, 2], [n] -> [n, 2]"""
    ideal = q
    for _ in range(UNDISTORTIONS):
        ideal = q / (1.0 + k[:, None] * (ideal**2).sum(axis=1, keepdims=True))
    return ideal


def nearest_to_rays(origins, directions):
    """The middle between two rays, and whether it is before both.  [n, 2, 3] -> [n, 3], [n]"""
    a, b = directions[:, 0], directions[:, 1]
    off = origins[:, 1] - origins[:, 0]
    aa, ab, bb = (a * a).sum(axis=1), (a * b).sum(axis=1), (b * b).sum(axis=1)
    fall = np.maximum(aa * bb - ab**2, 1e-12 * aa * bb)
    s = (bb * (a * off).sum(axis=1) - ab * (b * off).sum(axis=1)) / fall
    t = (ab * (a * off).sum(axis=1) - aa * (b * off).sum(axis=1)) / fall
    ends = origins + np.stack([s, t], axis=1)[..., None] * directions
    return ends.mean(axis=1), (s > 0.0) & (t > 0.0)


def seen_in(found, images, scales):
    """The features of a reconstruction's images that show points, and these points [p, 3]."""
    rows = {key: row for row, key in enumerate(found.points3D)}
    lenses = sorted({found.images[key].camera_id for key in images})
    cameras, points, pixels, sizes = [], [], [], []
    for row, key in enumerate(images):
        shown = [(i, p) for i, p in enumerate(found.images[key].points2D) if p.has_point3D()]
        cameras += [row] * len(shown)
        points += [rows[p.point3D_id] for _, p in shown]
        pixels += [p.xy for _, p in shown]
        sizes += [scales[row][i] for i, _ in shown]
    return Observed(
        np.array(cameras),
        np.array(points),
        np.array(pixels).reshape(-1, 2),
        np.median(sizes or [1.0]) / np.array(sizes),
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
