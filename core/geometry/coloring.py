"""Colors for constraints: the solver can solve all constraints of one color at once.

Two constraints that share a vertex get different colors.  Solving color after color is then
a Gauss–Seidel sweep, and its result does not depend on the order inside a color.  Each color
costs a barrier in each substep, so few colors are fast.

A mesh that was cut from a lattice takes the colors of the lattice (periodic.py).  On A15 they
are 14 for edges and 26 for tets, where greedy coloring needs 18 and 32.

Shapes: C constraints of n vertices each (n = 2 for edges, 4 for tets).
"""

import numpy as np

from .periodic import lattice_addresses, periodic_classes


def color_order(constraints, rest_vertices):
    """The order that groups constraints by color, and where each group begins.

    Args:
        constraints: Vertex ids.  [C, n]
        rest_vertices: [V, 3]

    Returns:
        Indices of the constraints, within a color in the given order [C]; offsets: color c
        is order[offsets[c]:offsets[c + 1]] [color_count + 1]; and the class of each constraint
        in the new order: lattice translates share one, -1 means no lattice [C].
    """
    colors, classes = lattice_colors(constraints, rest_vertices)
    colors = complete_colors(constraints, colors, len(rest_vertices))
    colors = np.unique(colors, return_inverse=True)[1].reshape(-1)  # without empty ones
    order = np.argsort(colors, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(np.bincount(colors))]).astype(np.int64)
    return order, offsets, classes[order]


def lattice_colors(constraints, rest_vertices):
    """The lattice's colors and classes of translates; -1 where there is none.  [C], [C] int"""
    colors = np.full(len(constraints), -1)
    classes = colors.copy()
    found = lattice_addresses(rest_vertices)
    if found is None or len(constraints) == 0:
        return colors, classes
    lattice, addresses, on_lattice = found
    regular = on_lattice[constraints].all(axis=1)
    colors[regular], classes[regular] = periodic_classes(lattice, addresses[constraints[regular]])
    # Vertices or constraints at the same place have the same lattice color: drop the later one.
    colored = np.flatnonzero(colors >= 0)
    touched = (colors[colored, None] * len(rest_vertices) + constraints[colored]).ravel()
    order = np.argsort(touched, kind="stable")
    again = order[1:][touched[order[1:]] == touched[order[:-1]]] // constraints.shape[1]
    colors[colored[again]] = -1
    return colors, classes


def complete_colors(constraints, colors, vertex_count):
    """The given colors; each -1 becomes the lowest color that no neighbor has so far.  [C] int

    Args:
        constraints: Vertex ids.  [C, n]
        colors: [C] int
        vertex_count: One more than the highest id.
    """
    used = [0] * vertex_count  # bit c: a constraint of color c touches this vertex
    colors = colors.copy()
    missing = np.flatnonzero(colors < 0)
    if len(missing) == 0:
        return colors
    near = np.zeros(vertex_count, bool)
    near[constraints[missing]] = True
    given = np.flatnonzero((colors >= 0) & near[constraints].any(axis=1))
    for vertices, color in zip(constraints[given].tolist(), colors[given].tolist(), strict=True):
        for vertex in vertices:
            used[vertex] |= 1 << color
    for constraint, vertices in zip(missing.tolist(), constraints[missing].tolist(), strict=True):
        taken = 0
        for vertex in vertices:
            taken |= used[vertex]
        lowest_free = ~taken & (taken + 1)
        colors[constraint] = lowest_free.bit_length() - 1
        for vertex in vertices:
            used[vertex] |= lowest_free
    return colors
