"""The minimum cut of a graph whose nodes are drawn to one side or the other.

A labelling says of each node whether it is kept.  Its cost is

    sum of pulls_i over the nodes that aren't kept
    + sum of ties_ij over the pairs of which one node is kept and one isn't

and `minimum_cut` returns a labelling with the least.  It is found as a maximum flow from a source,
to which nodes with a positive pull are tied, to a sink, by Dinic's method (SciPy).  SciPy's
capacities are whole numbers.

Shapes: N nodes, E pairs.
"""

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
    pulls: np.ndarray, pairs: np.ndarray, ties: np.ndarray, held: np.ndarray, groups: np.ndarray
) -> np.ndarray:
    """The same in a fraction of the time, of nodes that come in groups; not always the least.

    First the nodes of a group go together.  Then those of the groups at the border of what is kept
    go one by one, ROUNDS times, because the border moves (Lombaert et al. 2005, banded graph cuts).

    Args:
        groups: The group of each node.  [N] int
    """
    free = held == 0
    some = np.zeros(groups.max(initial=-1) + 1, bool)
    some[groups[free]] = True
    count, grouped = int(some.sum()), (np.cumsum(some) - 1)[groups[free]]
    ids = np.where(held > 0, count, count + 1)  # all that is held on one side is one node
    ids[free] = grouped
    coarse = ids[pairs]
    parted = coarse[:, 0] != coarse[:, 1]
    coarse_held = np.zeros(count + 2, int)
    coarse_held[count:] = 1, -1
    sums = np.bincount(grouped, pulls[free], count + 2)
    kept = minimum_cut(sums, coarse[parted], ties[parted], coarse_held)[ids]
    for _ in range(ROUNDS):
        at_border = np.zeros(count + 2, bool)
        at_border[ids[pairs[kept[pairs[:, 0]] != kept[pairs[:, 1]]]]] = True
        sides = np.where(at_border[ids] & free, 0, np.where(kept, 1, -1))
        kept = minimum_cut(pulls, pairs, ties, sides)
    return kept
