"""Cut a mesh in two halves, for two threads of a CPU.

If two threads share each color, each soon needs cache lines that the other has written, and
both wait at a barrier after every color.  Below some ten thousand tets that is slower than one
thread.  So each thread projects the constraints of one half of the mesh.  A constraint is near if
it touches a vertex that constraints of the other half touch, too.  A thread projects its near
constraints of a color only after the other thread has projected its near ones of the color before.
It projects the remaining constraints before and after these, so it hardly ever waits.

The colors keep their order, so the result has the same bits as without halves.

Shapes: V vertices, C constraints of n vertices each.
"""

from typing import NamedTuple

import numpy as np

from .constraints import ColoredConstraints

FEWEST_TETS, MOST_TETS = 5000, 50_000  # of a mesh that is cut; below, one thread is faster
MOST_SHARED = 0.15  # of the vertices; with more, one thread is as fast
GROUP = 8  # vertices; a cache line begins with each second or fourth of them
SECTIONS = 4  # of a color: the first half's, its near ones, the second's near ones, and others


class Halves(NamedTuple):
    """Which vertices are where.  [V] bool"""

    second: np.ndarray  # in the second half
    shared: np.ndarray  # touched by constraints of both halves

    @property
    def order(self):
        """The vertices in the order in which a frame keeps them.  [V] int

        The shared ones are neighbors, so that few cache lines go from one core to the other.
        """
        return np.argsort(np.where(self.second, 3 - self.shared, self.shared), kind="stable")

    @property
    def starts(self):
        """Where in that order each half's shared vertices begin and end, and the end.  [5] int"""
        sections = np.where(self.second, 3 - self.shared, self.shared)
        return np.append(0, np.cumsum(np.bincount(sections, minlength=SECTIONS)))

    def sections(self, constraints: ColoredConstraints):
        """The section of each constraint; one that joins the halves is in either.  [C] int"""
        second = self.second[constraints.vertices[:, 0]]
        near = self.shared[constraints.vertices].any(axis=1)
        return np.where(second, 3 - near, near)


def cut(rest_vertices, *lists: ColoredConstraints) -> Halves | None:
    """The halves of a mesh with these edges and tets; None if it is not cut.

    The cut goes through the middle of the edges across x, y or z, wherever it meets the fewest.
    """
    edges, tets = lists
    if not FEWEST_TETS <= len(tets.vertices) <= MOST_TETS:
        return None
    count = len(rest_vertices)
    degrees = np.bincount(edges.vertices.ravel(), minlength=count)
    best, fewest = None, len(edges.vertices) + 1
    for along in rest_vertices.T:
        order = np.argsort(along, kind="stable")
        middle = np.searchsorted(np.cumsum(degrees[order]), 0.5 * degrees.sum())
        second = np.ones(count, bool)
        second[order[: GROUP * round(middle / GROUP)]] = False
        joining = np.count_nonzero(_joining(second, edges))
        if joining < fewest:
            best, fewest = second, joining
    shared = np.zeros(count, bool)
    for constraints in lists:
        shared[constraints.vertices[_joining(best, constraints)]] = True
    return Halves(best, shared) if shared.mean() <= MOST_SHARED else None


def _joining(second, constraints):
    """Whether each constraint has vertices in both halves.  [C] bool"""
    sides = second[constraints.vertices]
    return sides.any(axis=1) & ~sides.all(axis=1)
