"""Group nearby tets into clusters, and list which clusters may collide.

All tets of a cluster belong to one part of the mesh.  While nothing touches, only boxes of clusters
are compared, and not in every frame.  If two clusters touch, the search goes on in their leaves,
which have a few tets each.

Two clusters of the same part may collide only if their boxes at rest are farther apart than a
margin.  Nearer ones are neighbors, or folds of one surface that the mesh hardly resolves.  Two
clusters of different parts may collide unless they go through each other at rest.

Shapes: V vertices, T tets, G clusters, L leaves, P points.
"""

from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np

from ...geometry import components

TETS_PER_CLUSTER = 16
TETS_PER_LEAF = 8
MOST_CLUSTERS = 128
MOST_COMPONENTS = 64  # smaller components than these are left out of contact
INSIDE = 0.05  # a point is inside a tet at rest if all its barycentric coordinates are larger


class Clusters(NamedTuple):
    """The clusters and leaves of a mesh; lists have offsets."""

    tets: np.ndarray  # [T] ids of tets, leaf by leaf
    tet_offsets: np.ndarray  # [L + 1]
    leaf_offsets: np.ndarray  # [G + 1] the leaves of each cluster
    vertices: np.ndarray  # ids of the vertices of each cluster
    vertex_offsets: np.ndarray  # [G + 1]
    partners: np.ndarray  # [G, G] 1 for clusters that may collide, else 0


def make_clusters(rest_vertices, tets, margin) -> Clusters:
    """The clusters of a mesh and their partners.

    Args:
        tets: Positively oriented.  [T, 4]
        margin: The distance at rest below which a component doesn't collide with itself [m].
    """
    component = components(len(rest_vertices), tets)[tets[:, 0]]
    middles = rest_vertices[tets].mean(axis=1)
    groups = _split(middles, component)
    groups = [ids for group in groups for ids in _connected(tets, group)]
    corners = [np.unique(tets[group]) for group in groups]
    lower = np.array([rest_vertices[ids].min(axis=0) for ids in corners])
    upper = np.array([rest_vertices[ids].max(axis=0) for ids in corners])
    of = np.array([component[group[0]] for group in groups])
    same = of[:, None] == of
    gap = np.maximum(lower[:, None] - upper, lower - upper[:, None]).max(axis=-1)
    may = np.where(same, gap > margin, True)
    for i, j in np.argwhere(np.triu(~same & (gap < 0.0))):
        if _go_through(rest_vertices, tets, groups, i, j):
            may[i, j] = may[j, i] = False
    leaves = [_leaves(middles, group) for group in groups]
    leaf_offsets = np.append(0, np.cumsum([len(one) for one in leaves])).astype(np.int32)
    of_leaves = _listed([leaf for one in leaves for leaf in one])
    return Clusters(*of_leaves, leaf_offsets, *_listed(corners), may.astype(np.int32))


def _split(middles, component):
    """Groups of tet ids: components, divided at the median of their longest side.  [T, 3], [T]"""
    order = np.argsort(component, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(component[order])) + 1)
    parts = sorted(parts, key=lambda ids: (-len(ids), ids[0]))[:MOST_COMPONENTS]
    heap = [(-len(ids), int(ids[0]), ids) for ids in parts]
    heapify(heap)
    while len(heap) < MOST_CLUSTERS and -heap[0][0] > TETS_PER_CLUSTER:
        _, _, ids = heappop(heap)
        for half in _halves(middles, ids):
            heappush(heap, (-len(half), int(half.min()), half))
    return [np.sort(ids) for _, _, ids in sorted(heap, key=lambda entry: entry[2].min())]


def _halves(middles, ids):
    axis = np.ptp(middles[ids], axis=0).argmax()
    return np.array_split(ids[np.argsort(middles[ids, axis], kind="stable")], 2)


def _leaves(middles, ids):
    if len(ids) <= TETS_PER_LEAF:
        return [np.sort(ids)]
    return [leaf for half in _halves(middles, ids) for leaf in _leaves(middles, half)]


def _connected(tets, group):
    """The tets of a group that share vertices, together: a group may span a gap."""
    used, corners = np.unique(tets[group], return_inverse=True)
    labels = components(len(used), corners.reshape(-1, 4))[corners.reshape(-1, 4)[:, 0]]
    return [group[labels == label] for label in np.unique(labels)]


def _go_through(rest_vertices, tets, groups, i, j):
    """Whether a corner or a middle of a tet of one group is inside a tet of the other."""
    for these, those in ((groups[i], groups[j]), (groups[j], groups[i])):
        corners = rest_vertices[tets[these]]
        points = np.concatenate([corners.reshape(-1, 3), corners.mean(axis=1)])
        if (barycentric(points, rest_vertices[tets[those]]).min(axis=-1) > INSIDE).any():
            return True
    return False


def barycentric(points, corners):
    """Barycentric coordinates of points [P, 3] in tets [T, 4, 3].  [P, T, 4]"""
    sides = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)  # [T, 3, 3]
    others = np.einsum("tij,ptj->pti", np.linalg.inv(sides), points[:, None] - corners[:, 0])
    return np.concatenate([1.0 - others.sum(axis=-1, keepdims=True), others], axis=-1)


def _listed(lists):
    """A list of lists as one array and offsets."""
    offsets = np.append(0, np.cumsum([len(one) for one in lists]))
    return np.concatenate(lists).astype(np.int32), offsets.astype(np.int32)
