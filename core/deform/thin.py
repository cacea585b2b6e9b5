"""How thin the parts of a mesh are, in layers of vertices, and the pieces in which they are fitted.

A lattice's factors (isotropy.py) are those of its endless inside.  Next to a surface edges lack
some of the tets around them, and the vertices there yield to strains that none in the inside
yields to.  In a thick body that makes no difference.  A sheet of one cell has no inside: by the
direction in which it is cut and bent it would be up to 1.6 times as stiff as finite elements on
the same tets, or .7 times.  So the edges of thin parts have factors of their own (sheets.py).

A vertex of the surface has the depth 0, its neighbors within have 1, and so on.  A sheet of A15
that is 1 to 1.5 cells thick has the greatest depth 1, one of 2 to 2.5 cells has 2, whatever its
direction.  What the greatest depth nearby is decides, within twice that depth: the corner of a
cube is √3 times as far from the inside as its faces are.

Shapes: V vertices, E edges, T tets.
"""

import numpy as np

from ..geometry import boundary_faces, face_components, tet_neighbours

WEIGHTS = (1.0, 1.0, 0.5)  # at the greatest depths 0, 1, 2; none where it is 3 or more
LEAST_TETS = 60  # of a piece: a smaller one has no layers to clamp
MOST_TETS = 4000  # of a piece, before its margin: the time to fit it grows with its width cubed
MARGIN = 8  # rings of tets around a piece that are fitted with it, as its ends are clamped or free
WITH_MARGIN = 1.5  # times its tets a piece gets no further ring: many small ones stay cheap


def thinness(tets, ends, vertex_count):
    """How much of a sheet's factor the edges at each vertex have: 0 to 1.  [V]

    Args:
        ends: The vertices at the ends of each edge.  [E, 2]
    """
    weights = np.full(vertex_count, WEIGHTS[0])
    outside = on_surface(tets, vertex_count)  # less than `depth` deep
    for depth in range(1, len(WEIGHTS) + 1):
        near = ~outside
        for _ in range(2 * depth):
            near = _with_neighbors(near, ends)
        weights[near] = WEIGHTS[depth] if depth < len(WEIGHTS) else 0.0
        outside = _with_neighbors(outside, ends)
    return weights


def on_surface(tets, vertex_count):
    """[V] bool"""
    surface = np.zeros(vertex_count, bool)
    surface[boundary_faces(tets, tet_neighbours(tets))[0]] = True
    return surface


def pieces(tets, centers, chosen):
    """The chosen tets in connected pieces of LEAST_TETS to MOST_TETS, each with its margin.

    Args:
        centers: Of each tet.  [T, 3]
        chosen: [T] bool

    Returns:
        For each piece the tets and those of them that are its own.  [N] int, [N] bool
    """
    neighbors = tet_neighbours(tets)
    found, waiting = [], [chosen]
    while waiting:
        labels = face_components(neighbors, waiting.pop())
        for label in range(labels.max(initial=-1) + 1):
            part = np.flatnonzero(labels == label)
            if len(part) > MOST_TETS:
                offsets = centers[part] - centers[part].mean(axis=0)
                along = offsets @ np.linalg.eigh(offsets.T @ offsets)[1][:, 2]
                order = part[np.argsort(along, kind="stable")]
                for half in np.array_split(order, 2):
                    waiting.append(np.zeros(len(tets), bool))
                    waiting[-1][half] = True
            elif len(part) >= LEAST_TETS:
                found.append(_with_margin(part, neighbors))
    return found


def _with_margin(part, neighbors):
    inside = np.zeros(len(neighbors), bool)
    inside[part] = True
    for _ in range(MARGIN):
        if inside.sum() > WITH_MARGIN * len(part):
            break
        beside = neighbors[inside]
        inside[beside[beside >= 0]] = True
    tets = np.flatnonzero(inside)
    return tets, np.isin(tets, part)


def _with_neighbors(marked, ends):
    """The marked vertices and those that share an edge with one.  [V] bool"""
    touched = marked.copy()
    touched[ends[marked[ends].any(axis=1)]] = True
    return touched
