"""The surface of a mesh for contact: its faces, sample points on it, and each tet's nearest faces.

A sample is the point (1 − share) x_p + share x_q.  Samples are the surface's vertices (p = q,
share 0) and the midpoints of its edges.  If only vertices were samples, coarse tets could pass
between them.

Shapes: V vertices, T tets, F faces, S samples, G clusters, L leaves.
"""

from typing import NamedTuple

import numpy as np

from ...definition.contact import CONTACT_SLACK, plane_weights
from ...geometry import boundary_faces, tet_neighbours
from .clusters import Clusters

STEEPEST = 3.0  # of a bevel
SHARP, RIM = 0.2, 0.05
EXITS = 24


class Surface(NamedTuple):
    """Sorted by leaf, as are the tets that it refers to."""

    tets: np.ndarray  # [T, 4]
    neighbours: np.ndarray  # [T, 4] of each tet across its faces, or -1
    faces: np.ndarray  # [F, 3] vertex ids, normals outward
    opposite: np.ndarray  # [F] the fourth vertex of a face's tet
    face_tets: np.ndarray  # [F]
    bevels: np.ndarray  # [F, 3] m; see `bevels`
    rims: np.ndarray  # [F, 3] the same
    tops: np.ndarray  # [F, 3] the same
    face_offsets: np.ndarray  # [L + 1] a leaf has the faces offsets[leaf]:offsets[leaf + 1]
    ends: np.ndarray  # [S, 2] p and q
    shares: np.ndarray  # [S] of q
    sample_clusters: np.ndarray  # [S]


def make_surface(rest_vertices, tets, clusters: Clusters) -> Surface:
    """The surface of positively oriented tets [T, 4]."""
    tets = tets[clusters.tets]
    leaf_count, cluster_count = len(clusters.tet_offsets) - 1, len(clusters.leaf_offsets) - 1
    leaf_of = np.repeat(np.arange(leaf_count), np.diff(clusters.tet_offsets))  # a tet
    cluster_of = np.repeat(np.arange(cluster_count), np.diff(clusters.leaf_offsets))  # a leaf
    neighbours = tet_neighbours(tets)
    faces, face_tets = boundary_faces(tets, neighbours)  # sorted by tet, so by leaf
    opposite = tets[face_tets].sum(axis=1) - faces.sum(axis=1)
    face_offsets = np.searchsorted(leaf_of[face_tets], np.arange(leaf_count + 1))
    vertices, first = np.unique(faces, return_index=True)
    pairs, first_pair = np.unique(
        np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1),
        axis=0,
        return_index=True,
    )
    ends = np.concatenate([np.stack([vertices, vertices], axis=1), pairs])
    shares = np.repeat([0.0, 0.5], [len(vertices), len(pairs)])
    owners = cluster_of[leaf_of[face_tets]][np.concatenate([first, first_pair]) // 3]
    order = np.argsort(owners, kind="stable")
    return Surface(
        tets.astype(np.int32),
        neighbours,
        faces,
        opposite.astype(np.int32),
        face_tets,
        *bevels(rest_vertices, faces),
        face_offsets.astype(np.int32),
        ends[order].astype(np.int32),
        shares[order],
        owners[order].astype(np.int32),
    )


def bevels(rest_vertices, faces):
    """How far inside a face a point behind it has to be, for each of its edges.  3 × [F, 3]

    Returns:
        As in `is_behind` of core/definition/contact.py: k times the length of the edge opposite
        each corner, k negative at a concave edge, and the least and the largest barycentric
        coordinate of that corner.  A face holds nothing that is nearer than RIM to a sharp edge,
        or to a corner on one.
    """
    a, b, c = (rest_vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    ends = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2), axis=1)
    lengths = np.linalg.norm(rest_vertices[ends[:, 0]] - rest_vertices[ends[:, 1]], axis=1)
    order = np.lexsort(ends.T)
    same = (ends[order[1:]] == ends[order[:-1]]).all(axis=1)
    slopes = np.full(len(ends), STEEPEST)
    for here, there in ((order[:-1][same], order[1:][same]), (order[1:][same], order[:-1][same])):
        f, g = here // 3, there // 3
        cosine = np.clip((normals[f] * normals[g]).sum(axis=1), -1.0, 1.0)
        slope = np.minimum(np.sqrt((1.0 - cosine) / np.maximum(1.0 + cosine, 1e-12)), STEEPEST)
        across = rest_vertices[faces.ravel()[there]] - rest_vertices[faces[f, 0]]
        convex = (normals[f] * across).sum(axis=1) < 0.0
        slopes[here] = np.minimum(slopes[here], np.where(convex, slope, -slope))
    rims = np.where(slopes > SHARP, RIM, -CONTACT_SLACK)
    on_sharp_edge = np.zeros(len(rest_vertices), bool)
    on_sharp_edge[ends[slopes > SHARP]] = True
    tops = np.where(on_sharp_edge[faces], 1.0 - RIM, 1.0 + CONTACT_SLACK)
    return (slopes * lengths).reshape(-1, 3), rims.reshape(-1, 3), tops


def exits(rest_vertices, surface: Surface):
    """Faces of its component by which a point in a tet may be nearest to the outside at rest.

    The faces of the tet itself, those nearest to its middle and its neighbors' middles, the faces
    beside these, and the faces at its corners.

    Returns:
        Face ids, -1 in unused places.  [T, EXITS]
    """
    nearest = _nearest_faces(rest_vertices, surface)
    tet_ids = np.arange(len(nearest))
    across = np.where(surface.neighbours >= 0, nearest[surface.neighbours], -1)
    rows = [surface.face_tets, tet_ids, *np.repeat(tet_ids[None], 4, axis=0)]
    faces = [np.arange(len(surface.faces)), nearest, *across.T]
    for beside in _faces_beside(surface.faces).T:
        rows += [surface.face_tets, tet_ids]
        faces += [beside, beside[nearest]]
    at_corner, corner = _incident(surface.tets, surface.faces)
    rows, faces = [*rows, at_corner], [*faces, corner]
    pairs = np.stack([np.concatenate(rows), np.concatenate(faces)], axis=1)
    ranks = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
    known = pairs[:, 1] >= 0
    pairs, ranks = pairs[known], ranks[known]
    keys = pairs[:, 0] * len(surface.faces) + pairs[:, 1]
    _, first = np.unique(keys, return_index=True)  # once each, with the first rank
    pairs, ranks = pairs[first], ranks[first]
    order = np.lexsort((ranks, pairs[:, 0]))
    pairs = pairs[order]
    place = np.arange(len(pairs)) - np.searchsorted(pairs[:, 0], pairs[:, 0])
    result = np.full((len(nearest), EXITS), -1, np.int32)
    kept = place < EXITS
    result[pairs[kept, 0], place[kept]] = pairs[kept, 1]
    return result


def _incident(tets, faces):
    """All pairs of a tet and a face that share a vertex.  2 × [N]"""
    order = np.argsort(faces.ravel(), kind="stable")
    vertices = faces.ravel()[order]
    begin, end = (np.searchsorted(vertices, tets.ravel(), side=side) for side in ("left", "right"))
    counts = end - begin
    first = np.repeat(begin - (np.cumsum(counts) - counts), counts)
    return np.repeat(np.arange(tets.size) // 4, counts), order[first + np.arange(len(first))] // 3


def _faces_beside(faces):
    """A face across each edge of a face, or -1.  [F, 3]"""
    ends = np.sort(faces[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2), axis=1)
    order = np.lexsort(ends.T)
    same = (ends[order[1:]] == ends[order[:-1]]).all(axis=1)
    beside = np.full(len(ends), -1)
    beside[order[:-1][same]] = order[1:][same] // 3
    beside[order[1:][same]] = order[:-1][same] // 3
    return beside.reshape(-1, 3)


def _nearest_faces(rest_vertices, surface: Surface):
    """The face that is nearest to each tet's middle at rest, among those of its component.  [T]

    Found by passing candidates from tet to tet, so now and then only a nearly nearest one.
    """
    middles = rest_vertices[surface.tets].mean(axis=1)
    best = np.full(len(middles), -1)
    distance = np.full(len(middles), np.inf)
    best[surface.face_tets] = np.arange(len(surface.faces))
    known = np.flatnonzero(best >= 0)
    distance[known] = _distances(rest_vertices, surface.faces[best[known]], middles[known])
    changed = best >= 0  # since its neighbors asked
    while changed.any():
        news, changed = changed, np.zeros_like(changed)
        for across in surface.neighbours.T:
            asks = np.flatnonzero((across >= 0) & (news | changed)[across] & (best[across] != best))
            offered = best[across[asks]]
            at = _distances(rest_vertices, surface.faces[offered], middles[asks])
            closer = at < distance[asks] * (1.0 - 1e-9)
            best[asks[closer]], distance[asks[closer]] = offered[closer], at[closer]
            changed[asks[closer]] = True
    return best


def _distances(vertices, faces, points):
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    weights = closest_weights(points - a, b - a, c - a)
    nearest = weights[:, 1:2] * (b - a) + weights[:, 2:] * (c - a)
    return np.linalg.norm(points - a - nearest, axis=1)


def closest_weights(r, e1, e2):
    """Barycentric coordinates of the point of triangles 0, e1, e2 that is nearest to r."""
    found = plane_weights(r, e1, e2)
    inside = (found >= 0.0).all(axis=-1)
    nearest = np.full(inside.shape, np.inf)
    corners = np.stack([np.zeros_like(e1), e1, e2], axis=-2)
    result = found.copy()
    for i, j in ((0, 1), (0, 2), (1, 2)):
        start, way = corners[..., i, :], corners[..., j, :] - corners[..., i, :]
        squared = np.maximum((way**2).sum(-1), 1e-300)
        share = np.clip(((r - start) * way).sum(-1) / squared, 0.0, 1.0)
        distance = np.linalg.norm(r - start - share[..., None] * way, axis=-1)
        weights = np.zeros_like(found)
        weights[..., i], weights[..., j] = 1.0 - share, share
        closer = distance < nearest
        nearest = np.where(closer, distance, nearest)
        result = np.where((closer & ~inside)[..., None], weights, result)
    return result
