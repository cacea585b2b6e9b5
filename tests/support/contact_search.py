"""Which contacts a frame has, in float64 NumPy: what the kernels of core/deform/contact find.

core/definition/contact.py has what contacts do in a substep.  Shapes: V vertices, S samples of the
surface, G clusters of tets, L leaves.
"""

import numpy as np

from deformrf.core.deform.contact.boxes import AWAKE
from deformrf.core.deform.contact.clusters import Clusters, barycentric
from deformrf.core.deform.contact.detection import (
    BESIDE,
    DEEP,
    KEPT,
    LEAST_VOLUME,
    MOST,
    NO_FACE,
    ONE_WAY,
)
from deformrf.core.deform.contact.surface import Surface, closest_weights


def boxes(clusters: Clusters, vertices, steps, margin):
    """Lowest and highest corners of the clusters' boxes.  2 × [G, 3]

    Args:
        steps: How far vertices move within a frame at their velocities.  [V, 3]
    """
    both = np.stack([vertices, vertices + steps], axis=1)[clusters.vertices].reshape(-1, 3)
    begins = 2 * clusters.vertex_offsets[:-1]
    lower, upper = (f.reduceat(both, begins, axis=0) for f in (np.minimum, np.maximum))
    return lower - margin, upper + margin


def overlaps(clusters: Clusters, lower, upper, moods):
    """The partners that each cluster overlaps.  G lists"""
    result = []
    for g in range(len(lower)):
        others = np.flatnonzero(clusters.partners[g])
        hit = (lower[g] <= upper[others]).all(axis=1) & (lower[others] <= upper[g]).all(axis=1)
        result.append(others[hit & (moods[others] + moods[g] > AWAKE)])
    return result


def find(
    clusters: Clusters,
    surface: Surface,
    exits,
    rest,
    vertices,
    ways,
    partners,
    margin,
    tolerance,
    exits_before,
):
    """Each sample's contacts, as detection.py lists them, and where it leaves the body or NO_FACE.

    Args:
        exits: surface.exits.  [T, EXITS]
        exits_before: Where each sample left in the frame before, or NO_FACE.  [S]
        rest, vertices: [V, 3]
        ways: How far vertices will move within the frame.  [V, 3]
        partners: See `overlaps`.
        margin, tolerance: See Contact.  [m]
    """
    found = []
    samples = surface.ends, surface.shares, surface.sample_clusters, exits_before
    for (p, q), s, g, before in zip(*samples, strict=True):
        point = (1.0 - s) * vertices[p] + s * vertices[q]
        way = (1.0 - s) * ways[p] + s * ways[q]
        faces = _members(clusters, surface.face_offsets, partners[g])
        pose = vertices, ways, margin, tolerance
        distances, behind = _distances(surface, faces, point, way, *pose)
        order = np.argsort(distances, kind="stable")[:MOST]
        listed = faces[order[np.isfinite(distances[order])]].tolist()
        tets = _members(clusters, clusters.tet_offsets, partners[g])
        tet, at_rest = _tet_around(surface, rest, vertices, tets, point)
        leaves_by = NO_FACE
        if tet is not None:
            shallow, on_rim = behind
            candidates = faces[shallow & ~on_rim]
            away = distances[shallow & ~on_rim]
            if not shallow.any():
                candidates = exits[tet][exits[tet] >= 0]
                away = _rest_distances(surface, rest, candidates, at_rest)
            if len(candidates) > 0:
                leaves_by = int(candidates[away.argmin()])
                if (away[candidates == before] < KEPT * away.min()).any():
                    leaves_by = int(before)
            elif before in exits[tet]:
                leaves_by = int(before)
        if listed:
            first = leaves_by if leaves_by != NO_FACE else listed[0]
            listed = _one_each_way(surface, vertices, [first, *listed])
        if leaves_by != NO_FACE:
            place = listed.index(leaves_by) if leaves_by in listed else min(len(listed), MOST - 1)
            listed[place : place + 1] = [DEEP - leaves_by]
        found.append((listed, leaves_by))
    return found


def _one_each_way(surface, vertices, faces):
    """The first face and those that look another way than those before; at most MOST."""
    a, b, c = (vertices[surface.faces[faces][:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    kept = [0]
    for i in range(1, len(faces)):
        if faces[i] != faces[0] and (normals[kept] @ normals[i]).max() <= ONE_WAY:
            kept.append(i)
    return [faces[i] for i in kept[:MOST]]


def _members(clusters, offsets, groups):
    """What the leaves of these clusters have by these offsets [L + 1]."""
    leaves = [offsets[clusters.leaf_offsets[group : group + 2]] for group in groups]
    return np.concatenate([np.empty(0, int), *(np.arange(*ends) for ends in leaves)])


def _distances(surface, faces, point, way, vertices, ways, margin, tolerance):
    """How near a point comes to the front of faces; infinite if not nearer than the margin.

    Also which it is behind already, but less deep than the tolerance, and which of them at a rim.
    """
    corners = surface.faces[faces]
    a, b, c = (vertices[corners[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    solid = (normal * (vertices[surface.opposite[faces]] - a)).sum(axis=1) < 0.0
    r = point - a
    height = (normal * r).sum(axis=1)
    w = closest_weights(r, b - a, c - a)
    relative = way - (w[:, :, None] * ways[corners]).sum(axis=1)
    closing = np.maximum(-(normal * relative).sum(axis=1), 0.0)
    share = np.clip(height / np.where(closing > 0.0, closing, np.inf), 0.0, 1.0)
    r = r + share[:, None] * relative
    w = closest_weights(r, b - a, c - a)
    distance = np.linalg.norm(r - w[:, 1:2] * (b - a) - w[:, 2:] * (c - a), axis=1)
    counts = solid & (height >= -tolerance) & (height - closing <= margin) & (distance <= margin)
    shallow = counts & (height < 0.0) & (distance <= tolerance)
    on_rim = distance > BESIDE * -height
    on_rim |= ((w < surface.rims[faces]) | (w > surface.tops[faces])).any(axis=1)
    return np.where(counts, distance, np.inf), (shallow, on_rim)


def _tet_around(surface, rest, vertices, tets, point):
    """The first of these tets that a point is inside, and its rest position; None, None outside."""
    volumes, rest_volumes = (
        np.linalg.det(x[surface.tets[tets, 1:]] - x[surface.tets[tets, :1]])
        for x in (vertices, rest)
    )
    tets = tets[volumes > LEAST_VOLUME * rest_volumes]
    if len(tets) == 0:
        return None, None
    inside = barycentric(point[None], vertices[surface.tets[tets]])[0]
    hits = np.flatnonzero(inside.min(axis=1) >= 0.0)
    if len(hits) == 0:
        return None, None
    return tets[hits[0]], inside[hits[0]] @ rest[surface.tets[tets[hits[0]]]]


def _rest_distances(surface, rest, faces, point):
    a, b, c = (rest[surface.faces[faces, i]] for i in range(3))
    w = closest_weights(point - a, b - a, c - a)
    return np.linalg.norm(point - a - w[:, 1:2] * (b - a) - w[:, 2:] * (c - a), axis=1)
