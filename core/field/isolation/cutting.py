"""The minimum cut of a graph whose nodes are drawn to one side or the other.

A labelling says of each node whether it is kept.  Its cost is

    sum of pulls_i over the nodes that aren't kept
    + sum of ties_ij over the pairs of which one node is kept and one isn't

and `minimum_cut` returns a labelling with the least.  It is found as a maximum flow from a source,
to which nodes with a positive pull are tied, to a sink, by Dinic's method (SciPy).  SciPy's
capacities are whole numbers.

Shapes: N nodes, E pairs.
"""

from collections.abc import Sequence

import numpy as np

ROUNDS = 2  # of single nodes at the border
WHOLE = 1000.0  # of SciPy's units in a tie of 1
MOST = 1e6  # of a tie or a pull, so that sums of flows fit 32 bits


def minimum_cut(
    pulls: np.ndarray, pairs: np.ndarray, ties: np.ndarray, held: np.ndarray
) -> np.ndarray:
    """Which nodes are kept.  [N] bool

    Args:
        pulls: What it costs not to keep a node; if negative, to keep it.  [N]
        pairs: [E, 2] int
        ties: What it costs to part a pair, 0 or more.  [E]
        held: 1 of a node that is kept in any case, -1 of one that isn't, else 0.  [N] int
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    free = held == 0
    source, sink = int(free.sum()), int(free.sum()) + 1
    ids = np.where(held > 0, source, np.where(held < 0, sink, np.cumsum(free) - 1))
    ids = ids.astype(np.int32)  # SciPy's own type
    a, b = ids[pairs].T
    inner = (a != b) & (a + b != source + sink)
    own = np.arange(source, dtype=np.int32)
    pulled = pulls[free]
    a, b = a[inner], b[inner]
    rows = np.concatenate([a, b, np.full_like(own, source), own])
    columns = np.concatenate([b, a, own, np.full_like(own, sink)])
    sizes = [ties[inner], ties[inner], np.maximum(pulled, 0.0), np.maximum(-pulled, 0.0)]
    capacities = np.rint(WHOLE * np.minimum(np.concatenate(sizes), MOST / WHOLE)).astype(np.int32)
    some = (capacities > 0) & (rows != sink) & (columns != source)
    entries = (capacities[some], (rows[some], columns[some]))
    graph = csr_array(entries, shape=(source + 2,) * 2)
    graph.sum_duplicates()
    flow = maximum_flow(graph, source, sink).flow
    rest = csr_array(graph - flow)
    rest.data = np.maximum(rest.data, 0)
    rest.eliminate_zeros()
    reached = breadth_first_order(rest, source, return_predecessors=False)
    kept = held > 0
    kept[np.flatnonzero(free)[reached[reached < source]]] = True
    return kept


def near_minimum_cut(
    pulls: np.ndarray,
    pairs: np.ndarray,
    ties: np.ndarray,
    held: np.ndarray,
    groups: Sequence[np.ndarray],
) -> np.ndarray:
    """The same in a fraction of the time, of nodes that come in groups; not always the least.

    First the nodes of a group go together, of the largest groups.  Then what the groups at the
    border of what is kept consist of goes by itself: smaller groups, at last the single nodes of
    the smallest ones, ROUNDS times, because the border moves (Lombaert et al. 2005, banded graph
    cuts).

    Args:
        groups: The group of each node [N] int, of large groups, then of smaller ones within these.
    """
    sides, single = held, np.arange(len(held))
    steps = [*zip(groups, groups, strict=True), *[(single, groups[-1])] * ROUNDS]
    for group, next_free in steps:
        kept, parted = cut_by_groups(pulls, pairs, ties, sides, group)
        at_border = np.zeros(next_free.max(initial=-1) + 1, bool)
        at_border[next_free[pairs[parted]]] = True
        sides = np.where(at_border[next_free] & (held == 0), 0, np.where(kept, 1, -1))
    return kept


def cut_by_groups(pulls, pairs, ties, held, group) -> tuple[np.ndarray, np.ndarray]:
    """The same where the free nodes of a group go together.

    Args:
        group: The group of each node.  [N] int

    Returns:
        Which nodes are kept [N] bool, and the ids of the pairs that this parts.
    """
    free = held == 0
    own = group[free]
    some = np.zeros(group.max(initial=-1) + 1, bool)
    some[own] = True
    numbers = np.cumsum(some, dtype=np.int32) - 1
    count = int(some.sum())
    # All that is held on one side is one node.
    ids = np.where(held > 0, np.int32(count), np.int32(count + 1))
    ids[free] = own = numbers[own]
    one, other = (ids[column] for column in pairs.T)
    between = np.flatnonzero(one != other)  # most pairs lie within a group, and cost nothing
    coarse = np.stack([one[between], other[between]]).T
    coarse_held = np.zeros(count + 2, int)
    coarse_held[count:] = 1, -1
    sums = np.bincount(own, pulls[free], count + 2)
    kept = minimum_cut(sums, coarse, ties[between], coarse_held)
    return kept[ids], between[kept[coarse[:, 0]] != kept[coarse[:, 1]]]
