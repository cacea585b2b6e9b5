"""Braces: extra edges, of no tet, that make hinges stiff.

A block is a set of tets that are connected through faces.  In a mesh that was cut from a grid by
occupancy, some blocks share only one edge or one vertex with the others.  That is a hinge: no edge
length resists a rotation there.

Short braces join the corners of tets that share a vertex but belong to two blocks.  They fix a
small block.  Two large blocks would still swing slowly.  The short braces are a neck of one
element, of width d; it resists a turn with about E d³/12, while the blocks' moments of inertia
grow with the fifth power of their size.  Therefore, where two large blocks touch, long braces join
three places in one to three in the other, all at most REACH from the hinge.  A block's three places
and the hinge do not lie in one plane, so no mirror image of the pose has the same lengths.

Shapes: V vertices, T tets, B braces.
"""

from itertools import combinations, pairwise, product

import numpy as np

from ..geometry import EDGES, face_components, signed_volumes, tet_neighbours

SHORT_VOLUME = 0.25  # V_e of a short brace, in means over edges; a hinge has many of them
LONG_STIFFNESS = 1.0  # of a long brace, in those of a mean edge; 4 would gain 10 % of f₁
REACH = 0.4  # of the smaller block's size, the cube root of its volume
LEAST_REACH = 1.0  # mean edges; short braces reach so far
FLAT = 0.05  # |det| of the directions to three places that are as good as in a plane


def hinge_braces(rest_vertices, tets, mean_edge):
    """Short and long braces, as pairs of vertices.  [B, 2] and [B', 2] int

    Args:
        mean_edge: The mean length of the mesh's edges [m].
    """
    labels = face_components(tet_neighbours(tets))
    pairs = np.unique(np.stack([tets.ravel(), np.repeat(labels, 4)], axis=1), axis=0)
    again = pairs[1:, 0] == pairs[:-1, 0]
    if not again.any():  # as with most meshes
        return _sorted(()), _sorted(())
    # Vertices of several blocks, with each of these, sorted.
    contacts = pairs[np.append(again, False) | np.append(False, again)]
    edges = set(map(tuple, np.sort(tets[:, EDGES].reshape(-1, 2), axis=1).tolist()))
    short = _short_braces(tets, labels, np.unique(contacts[:, 0])) - edges
    far = _long_braces(rest_vertices, tets, labels, contacts, LEAST_REACH * mean_edge)
    return _sorted(short), _sorted(far - short - edges)


def _sorted(pairs):
    return np.array(sorted(pairs), np.int64).reshape(-1, 2)


def _short_braces(tets, labels, hinges):
    """Pairs of corners of tets that share one of the vertices `hinges` but no block."""
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
    return braces


def _long_braces(rest_vertices, tets, labels, contacts, least_reach):
    """Pairs of places in two blocks that touch and whose reach is at least so long [m]."""
    volumes = np.bincount(labels, np.abs(signed_volumes(rest_vertices, tets)))
    reaches = REACH * np.cbrt(volumes)
    contacts = contacts[reaches[contacts[:, 1]] > least_reach].tolist()
    shared_by = {}  # vertices of two large blocks; a third one is joined to the second
    for (vertex, block), (same, other) in pairwise(contacts):
        if vertex == same:
            shared_by.setdefault((block, other), []).append(vertex)
    braces = set()
    for blocks, shared in shared_by.items():
        reach = reaches[list(blocks)].min()
        ends = [
            _places(rest_vertices, np.setdiff1d(tets[labels == block], shared), shared, reach)
            for block in blocks
        ]
        braces.update((min(pair), max(pair)) for pair in product(*ends))
    return braces


def _places(rest_vertices, candidates, hinge, reach):
    """Three of the vertices within reach of the vertices `hinge`, far from these; or none.

    A lever arm is a place's distance from the nearest of them: about a line of vertices, a place
    beside the line has none.
    """
    at = rest_vertices[candidates]
    levers = np.full(len(at), np.inf)
    for vertex in rest_vertices[hinge]:
        np.minimum(levers, np.linalg.norm(at - vertex, axis=1), out=levers)
    near = levers <= reach
    if not near.any():
        return []
    candidates, levers = candidates[near], levers[near] / reach
    arms = (at[near] - rest_vertices[hinge].mean(axis=0)) / reach
    first = levers.argmax()
    across = np.cross(arms[first], arms)
    second = (levers * np.linalg.norm(across, axis=1)).argmax()
    heights = np.abs(arms @ across[second])
    third = (levers * heights).argmax()
    return candidates[[first, second, third]].tolist() if heights[third] > FLAT else []
