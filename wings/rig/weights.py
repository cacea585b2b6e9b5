"""Weights: how much each bone moves each vertex.

    harmonic   of given weights on the surface: Δw = 0 inside, so w has no maximum there
    nearest    those of the nearest surface point
    rigid      1 for the nearest bone
    automatic  from the bones alone: −Δw_b + h (w_b − p_b) = 0 with h = HEAT / d², d = min d_b the
               distance to the nearest bone, and p_b = d_b^−SHARPNESS / Σ_c d_c^−SHARPNESS: heat
               that flows from the bones (the idea of Baran and Popović 2007, here in the volume)

So w_b is about 1 on bone b and ½ where it meets the next one.  p_b has no jump there, unlike 1 for
the nearest bone alone: heat may be strong, and tets do not tear.  Nothing here has a length: an
object of another size, or a finer mesh, has the same weights.

Distances to bones are measured through the mesh, so that a bone of one leg has no weight in the
other leg, however near.  All weights are ≥ 0 and sum to 1; those below LEAST become 0.

Shapes: V vertices, B bones, S points of a surface.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from ...core.geometry import TetMesh, components
from .laplacian import Laplacian, laplacian, solved
from .skeleton import Skeleton

LEAST = 1e-3
NEGLIGIBLE = 1e-4  # offsets, as a share of a surface's size
# Both were chosen by measurements: docs/design/010-rigs.md.
HEAT = 10.0  # less is smoother, and weaker where the mesh is coarse
SHARPNESS = 6.0  # of what bones share: more is nearer to one bone each
TINY = 1e-30  # a distance of 0 is taken for this
DETOUR = 1.25  # along edges a straight way is up to so much longer
SEEDS = 24  # points of a bone from which distances are measured
BLOCK = 2**22  # numbers of a table of distances
FEWEST = 4  # driven vertices of a bone, which fix a rigid motion


def automatic_weights(
    mesh: TetMesh, skeleton: Skeleton, moving: np.ndarray | None = None
) -> np.ndarray:
    """From the bones alone.  [V, B] float32

    Args:
        moving: Which bones move vertices [B] bool; None: all.
    """
    operator = laplacian(mesh)
    distances = bone_distances(mesh, operator, skeleton)
    if moving is not None:
        distances[:, ~moving] = np.inf
    nearest = np.maximum(distances.min(axis=1), TINY)
    sources = (nearest[:, None] / np.maximum(distances, TINY)) ** SHARPNESS
    sources /= sources.sum(axis=1, keepdims=True)
    closest = 0.5 * np.cbrt(operator.volumes)  # a vertex on a bone is not pulled infinitely
    pull = HEAT * operator.volumes / np.maximum(nearest, closest) ** 2
    return cleaned(solved(operator, pull, pull[:, None] * sources))


def harmonic_weights(mesh: TetMesh, ids: ArrayLike, surface_weights: np.ndarray) -> np.ndarray:
    """Of given weights at some vertices, those of all.  [V, B] float32

    Parts of the mesh without any of these vertices take the weights of the nearest one.

    Args:
        ids: Vertices [S].
        surface_weights: Theirs [S, B].
    """
    ids = np.asarray(ids)
    values = np.zeros((mesh.vertex_count, surface_weights.shape[1]))
    values[ids] = surface_weights
    fixed = np.zeros(mesh.vertex_count, bool)
    fixed[ids] = True
    labels = components(mesh.vertex_count, mesh.tets)
    alone = ~np.isin(labels, labels[ids])
    w = solved(laplacian(mesh), np.zeros(mesh.vertex_count), values, fixed | alone)
    return cleaned(copied_to_lone_parts(mesh, w, alone))


def copied_to_lone_parts(mesh: TetMesh, weights, alone) -> np.ndarray:
    """The weights; a part `alone` moves as one, as the nearest vertex of the others.  [V, B]"""
    if alone.any():
        others = np.flatnonzero(~alone)
        labels = components(mesh.vertex_count, mesh.tets)
        near, distances = _nearest(mesh.rest_vertices, mesh.rest_vertices[others])
        for label in np.unique(labels[alone]):
            members = np.flatnonzero(labels == label)
            closest = members[distances[members].argmin()]
            weights[members] = weights[others[near[closest]]]
    return weights


def rigid_weights(
    mesh: TetMesh, skeleton: Skeleton, moving: np.ndarray | None = None
) -> np.ndarray:
    """1 for the bone, of those `moving`, that is nearest through the mesh.  [V, B] float32"""
    distances = bone_distances(mesh, laplacian(mesh), skeleton)
    if moving is not None:
        distances[:, ~moving] = np.inf
    return np.eye(skeleton.bone_count, dtype=np.float32)[distances.argmin(axis=1)]


def nearest_point_weights(
    mesh: TetMesh, points: np.ndarray, triangles: np.ndarray, point_weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None]:
    """Of a skinned surface, those of the point p of it that is nearest, and its offsets.

    With corners x_i and barycentric coordinates β_i they are o_b = Σ_i β_i w_ib (x_i − p).

    Returns:
        Weights [V, B] float32, and offsets [V, B, 3] float32 or None.
    """
    points, count = np.asarray(points, float), point_weights.shape[1]
    moments = point_weights[:, :, None] * points[:, None]  # [S, B, 3]
    values = np.concatenate([point_weights, moments.reshape(len(points), -1), points], axis=1)
    values = _nearest_values(mesh.rest_vertices, points, triangles, values)
    weights, moments, places = values[:, :count], values[:, count:-3], values[:, -3:]
    offsets = moments.reshape(-1, count, 3) - weights[:, :, None] * places[:, None]
    weights = cleaned(weights / weights.sum(axis=1, keepdims=True))
    return weights, cleaned_offsets(offsets, weights, np.ptp(points, axis=0).max())


def _nearest_values(places, points, triangles, values):
    """Of values at a surface's points [S, K], those of its point nearest to each place.  [N, K]"""
    found = np.empty((len(places), values.shape[1]))
    corners = np.asarray(points, float)[triangles]
    rows = max(1, BLOCK // (16 * max(1, len(triangles))))
    for first in range(0, len(places), rows):
        triangle, bary = nearest_on_triangles(places[first : first + rows], corners)
        near = values[triangles[triangle]]
        found[first : first + rows] = np.einsum("nc,ncb->nb", bary, near)
    return found


def nearest_on_triangles(places, corners):
    """The nearest point of a set of triangles [M, 3, 3], for each place [N, 3].

    Returns:
        The triangle [N], and barycentric coordinates in it [N, 3].
    """
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    offset = places[:, None] - a
    d1, d2 = np.sum(offset * ab, axis=2), np.sum(offset * ac, axis=2)
    bb, cc, bc = np.sum(ab * ab, axis=1), np.sum(ac * ac, axis=1), np.sum(ab * ac, axis=1)
    area = np.maximum(bb * cc - bc * bc, 1e-30)
    v, w = (cc * d1 - bc * d2) / area, (bb * d2 - bc * d1) / area
    inside = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0) & (bb * cc - bc * bc > 1e-12 * bb * cc)
    # Else the nearest point lies on one of the three sides.
    on_ab = np.clip(d1 / np.maximum(bb, 1e-30), 0.0, 1.0)
    on_ac = np.clip(d2 / np.maximum(cc, 1e-30), 0.0, 1.0)
    side = np.maximum(bb + cc - 2.0 * bc, 1e-30)
    on_bc = np.clip((bb - bc + d2 - d1) / side, 0.0, 1.0)  # from b to c
    zero = np.zeros_like(v)
    options = [(on_ab, zero), (zero, on_ac), (1.0 - on_bc, on_bc), (v, w)]

    def squared(v, w):
        away = offset - v[..., None] * ab - w[..., None] * ac
        return np.sum(away * away, axis=2)

    lengths = [squared(*option) for option in options]
    lengths[3] = np.where(inside, lengths[3], np.inf)
    lengths = np.stack(lengths)
    which, triangle = np.unravel_index(
        np.moveaxis(lengths, 0, 1).reshape(len(places), -1).argmin(axis=1), (4, len(corners))
    )
    row = np.arange(len(places))
    v, w = (np.stack([o[i] for o in options])[which, row, triangle] for i in range(2))
    return triangle, np.stack([1.0 - v - w, v, w], axis=1)


def bone_distances(mesh: TetMesh, operator: Laplacian, skeleton: Skeleton) -> np.ndarray:
    """The distance of each vertex to each bone, through the mesh.  [V, B]

    It is measured along edges, from the vertices near points of the bone: those within the length
    of their edges, or of a part of the mesh that has none those that are an edge farther than its
    nearest one at most.  Where that is hardly longer than the straight distance, nothing lies
    between, and the straight one counts.
    """
    x = mesh.rest_vertices
    shares = np.linspace(0.0, 1.0, SEEDS)[:, None]
    labels = components(mesh.vertex_count, mesh.tets)
    parts = np.split(np.argsort(labels, kind="stable"), np.cumsum(np.bincount(labels))[:-1])
    lengths = np.linalg.norm(x[operator.ends] - np.repeat(x, operator.counts, axis=0), axis=1)
    reach = np.maximum.reduceat(lengths, operator.starts)
    found = np.full((mesh.vertex_count, skeleton.bone_count), np.inf)
    direct = np.empty_like(found)
    for bone in range(skeleton.bone_count):
        straight = _to_segment(x, skeleton.heads[bone], skeleton.tails[bone])
        direct[:, bone] = straight
        seeds = skeleton.heads[bone] + shares * (skeleton.tails[bone] - skeleton.heads[bone])
        close = np.zeros(mesh.vertex_count, bool)
        close[_nearest(seeds, x)[0]] = True
        close |= straight <= (1.0 + 1e-9) * reach
        for members in parts:
            if not close[members].any():
                close[members] = straight[members] <= straight[members].min() + reach[members]
        found[close, bone] = straight[close]
    while True:  # Bellman and Ford: each round goes one edge farther
        through = found[operator.ends] + lengths[:, None]
        shorter = np.minimum(found, np.minimum.reduceat(through, operator.starts, axis=0))
        if (shorter >= found - 1e-12).all():
            return np.where(found <= DETOUR * direct, direct, found)
        found = shorter


def driven_vertices(mesh: TetMesh, skeleton: Skeleton, softness: float) -> np.ndarray:
    """The vertices that follow the bones exactly, where physics moves the others.  [K] ids, sorted

    Each bone has the vertices to which it is the nearest one.  Of these, the share 1 − softness
    that is nearest to it follows; a few always do, so that no bone loses what it moves.

    Raises:
        ValueError: The softness is not from 0 to 1.
    """
    if not 0.0 <= softness <= 1.0:
        raise ValueError(f"the softness is {softness}; it is from 0 to 1")
    used = np.unique(mesh.tets)
    distances = np.stack(
        [
            _to_segment(mesh.rest_vertices[used], head, tail)
            for head, tail in zip(skeleton.heads, skeleton.tails, strict=True)
        ]
    )  # [B, N]
    nearest, found = distances.argmin(axis=0), []
    for bone in range(skeleton.bone_count):
        own = np.flatnonzero(nearest == bone)
        count = min(max(math.ceil((1.0 - softness) * len(own)), FEWEST), len(own))
        found.append(own[np.argsort(distances[bone, own], kind="stable")[:count]])
    return np.sort(used[np.concatenate(found)])


def _to_segment(points, a, b):
    """The distance of points from the segment a b.  [N]"""
    along = b - a
    share = np.clip((points - a) @ along / max(along @ along, 1e-30), 0.0, 1.0)
    return np.linalg.norm(points - a - share[:, None] * along, axis=1)


def _nearest(places, points):
    """The nearest of the points for each place [N], and its distance [N]."""
    rows = max(1, BLOCK // max(1, len(points)))
    ids, distances = [], []
    squares = np.sum(points * points, axis=1)
    for first in range(0, len(places), rows):
        some = places[first : first + rows]
        closest = (squares - 2.0 * some @ points.T).argmin(axis=1)
        ids.append(closest)
        distances.append(np.linalg.norm(some - points[closest], axis=1))
    return np.concatenate(ids), np.concatenate(distances)


def cleaned(weights) -> np.ndarray:
    """Without what is too small to matter; rows sum to 1.  [V, B] float32"""
    weights = np.where(weights >= LEAST, weights, 0.0)
    sums = weights.sum(axis=1, keepdims=True)
    assert (sums > 0.5).all(), "weights have no sources"
    return (weights / sums).astype(np.float32)


def cleaned_offsets(offsets, weights, size: float) -> np.ndarray | None:
    """Without those of bones that have no weight; rows sum to 0.  [V, B, 3] float32

    None if all are negligible for a surface of that size.
    """
    offsets = np.where(weights[:, :, None] > 0.0, offsets, 0.0)
    offsets = offsets - weights[:, :, None] * offsets.sum(axis=1, keepdims=True)
    needed = np.abs(offsets).max() > NEGLIGIBLE * size
    return offsets.astype(np.float32) if needed else None
