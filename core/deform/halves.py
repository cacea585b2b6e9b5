"""Two halves of a mesh for two threads of a CPU.

Where threads share each color, a core soon needs cache lines that the other one has written,
and both wait at a barrier after every color: below some ten thousand tets two threads were
slower than one.  So the mesh is cut in two.  Each thread projects the constraints of its own
half, first edges and then tets, one color after another.  Then one thread projects those that
join the halves, in the same order.

The order of constraints is part of the solver's result, so it depends on the mesh alone and
not on the number of threads.

Shapes: V vertices, C constraints of n vertices each.
"""

from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np

from .constraints import Constraints, EdgeConstraints, VolumeConstraints

FEWEST_TETS, MOST_TETS = 5000, 50_000  # of a mesh that is cut; below, one thread is faster
GROUP = 8  # vertices; a cache line begins with each second or fourth of them


class Halves(NamedTuple):
    """Where a frame keeps the vertices."""

    order: np.ndarray  # [V] int, the first half first
    first_count: int  # vertices of the first half


def cut(rest_vertices, edges: EdgeConstraints, volumes: VolumeConstraints, on_cpu=True):
    """The constraints by halves, and the halves; unchanged and None if the mesh isn't cut."""
    if not on_cpu or not FEWEST_TETS <= len(volumes.vertices) <= MOST_TETS:
        return edges, volumes, None
    second = _second_half(rest_vertices, edges)
    lists = edges, volumes
    # Vertices that are joined to the other half are neighbors, so that few cache lines go from
    # one core to the other.
    joined = np.zeros(len(second), bool)
    for part in lists:
        sides = second[part.vertices]
        joined[part.vertices[sides.any(axis=1) & ~sides.all(axis=1)]] = True
    order = np.argsort(np.where(second, 3 - joined, joined), kind="stable")
    return *(_by_halves(part, second) for part in lists), Halves(order, np.count_nonzero(~second))


def _second_half(rest_vertices, edges):
    """Which vertices are in the second half.  [V] bool

    The cut goes through the middle of the edges across x, y or z, wherever it meets the fewest.
    """
    count = len(rest_vertices)
    degrees = np.bincount(edges.vertices.ravel(), minlength=count)
    best, fewest = None, len(edges.vertices) + 1
    for along in rest_vertices.T:
        order = np.argsort(along, kind="stable")
        middle = np.searchsorted(np.cumsum(degrees[order]), 0.5 * degrees.sum())
        side = np.ones(count, bool)
        side[order[: GROUP * round(middle / GROUP)]] = False
        joining = np.count_nonzero(side[edges.vertices[:, 0]] != side[edges.vertices[:, 1]])
        if joining < fewest:
            best, fewest = side, joining
    return best


def _by_halves(constraints: Constraints, second):
    """The same constraints: the first half's by color, the second's, and those that join them."""
    color_count = len(constraints.offsets) - 1
    in_second = second[constraints.vertices].sum(axis=1)  # [C]
    run = np.where(in_second == 0, 0, np.where(in_second == constraints.vertices.shape[1], 1, 2))
    colors = run * color_count + np.repeat(np.arange(color_count), np.diff(constraints.offsets))
    order = np.argsort(colors, kind="stable")
    counts = np.bincount(colors, minlength=3 * color_count)
    names = [f.name for f in fields(constraints) if f.name not in ("offsets", "has_halves")]
    arrays = {name: getattr(constraints, name)[order] for name in names}
    offsets = np.concatenate([[0], np.cumsum(counts)])
    return replace(constraints, offsets=offsets, has_halves=True, **arrays)
