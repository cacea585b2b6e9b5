"""Extra edges that make hinges stiff.

A mesh that was cut from a grid by occupancy has tets that are joined to the rest by one edge
or one vertex only.  No edge length resists their rotation there: after a drag they would stay
turned.  So two tets that share a vertex but aren't connected through faces get braces, edges
from every corner of one to every corner of the other.

Shapes: V vertices, T tets, B braces.
"""

from itertools import combinations, product

import numpy as np

from ..geometry import EDGES, face_components, tet_neighbours


def hinge_braces(tets):
    """Pairs of vertices to join, none of them an edge of a tet.  [B, 2] int"""
    labels = face_components(tet_neighbours(tets))
    shared = np.unique(np.stack([tets.ravel(), np.repeat(labels, 4)], axis=1), axis=0)[:, 0]
    hinges = np.unique(shared[1:][shared[1:] == shared[:-1]])
    corner_order = np.argsort(tets.ravel(), kind="stable")
    begin, end = (
        np.searchsorted(tets.ravel()[corner_order], hinges, side=side) for side in ("left", "right")
    )
    braces = set()
    for first, last in zip(begin, end, strict=True):
        around = corner_order[first:last] // 4
        for one, other in combinations(around, 2):
            if labels[one] != labels[other]:
                pairs = product(tets[one].tolist(), tets[other].tolist())
                braces.update((min(pair), max(pair)) for pair in pairs if pair[0] != pair[1])
    if not braces:  # as with most meshes, which then need no set of all edges
        return np.empty((0, 2), np.int64)
    braces -= set(map(tuple, np.sort(tets[:, EDGES].reshape(-1, 2), axis=1).tolist()))
    return np.array(sorted(braces), np.int64).reshape(-1, 2)
