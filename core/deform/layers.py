"""Solve a body that is clamped at one end, for every depth of the clamp at once.

Nodes are in layers, and no element spans more than two.  Layers are eliminated from the free end,
as in a multifrontal factorization: S_l is what is then left of the matrix of layer l, and F_l of
its loads.  Where the layers up to l are held, the work of the loads is the sum of
F_kᵀ S_k⁻¹ F_k over the layers k > l.

Shapes: N nodes, M elements of K nodes, L loads, P clamps: P + 1 is the number of layers.
"""

import numpy as np

FLOOR = 1e-12  # of the mean trace of an element: what turns about a hinge is stiff, too


def count_layers(ends, first):
    """How many edges each vertex is away from the first ones; -1 where none leads.  [V] int

    Args:
        ends: [E, 2]
        first: [V] bool
    """
    layers, reached = np.where(first, 0, -1), first
    while reached.any():
        touched = np.zeros(len(first), bool)
        touched[ends[reached[ends].any(axis=1)]] = True
        reached = touched & (layers < 0)
        layers[reached] = layers.max() + 1
    return layers


class Layers:
    """A body whose layers are eliminated.

    Attributes:
        works: W_ij = F_i · u_j, where the layers 0, 0 to 1, … are held.  [P, L, L]
    """

    def __init__(self, layers, early, elements, loads):
        """
        Args:
            layers: Of each node.  [N] int
            early: Whether a node shares elements with its own layer and the one below alone;
                such nodes are eliminated first, on their own.  [N] bool
            elements: Of each kind the nodes [M, K] and stiffnesses [M, 3K, 3K].
            loads: Forces on the nodes.  [N, 3, L]
        """
        self._size, _, self._loads = loads.shape
        self._steps = []  # layer, its degrees of freedom, those they act on, solved [·, L + ·]
        floor = FLOOR * np.mean(np.concatenate([each.trace(0, 1, 2) for _, each in elements]))
        kinds = [(*kind, layers[kind[0]].max(axis=1)) for kind in elements]
        rest, passed = loads.reshape(-1, self._loads).copy(), 0.0
        works = [np.zeros((self._loads, self._loads))]
        for layer in range(layers.max(), 0, -1):
            first, second = (np.flatnonzero((layers == layer) & each) for each in (early, ~early))
            below = np.flatnonzero((layers == layer - 1) & ~early)
            nodes = np.concatenate([first, second, below])
            matrix = self._front(nodes, [(n[t == layer], k[t == layer]) for n, k, t in kinds])
            matrix[np.diag_indices(len(matrix))] += floor
            start, stop = 3 * len(first), 3 * (len(first) + len(second))
            matrix[start:stop, start:stop] += passed
            work = works[-1]
            for begin, end in (0, start), (start, stop):
                own, later = slice(begin, end), slice(end, None)
                work = work + self._eliminate(layer, nodes, matrix, own, later, rest)
            works.append(work)
            passed = matrix[stop:, stop:]
        self.works = np.stack(works[:0:-1])

    def moved(self):
        """How far the loads move nodes, where the layers 0, 0 to 1, … are held.  [P, N, 3, L]"""
        moved = np.zeros((len(self.works), 3 * self._size, self._loads))
        for clamp, of_clamp in enumerate(moved):
            for layer, own, later, solved in reversed(self._steps):
                if layer > clamp:
                    passed = solved[:, self._loads :] @ of_clamp[later]
                    of_clamp[own] = solved[:, : self._loads] - passed
        return moved.reshape(-1, self._size, 3, self._loads)

    def _front(self, nodes, elements):
        """The matrix of some elements, for these nodes."""
        place = np.zeros(self._size, int)
        place[nodes] = np.arange(len(nodes))
        width = 3 * len(nodes)
        matrix = np.zeros(width * width)
        for of_elements, stiffnesses in elements:
            at = 3 * place[of_elements][:, :, None] + np.arange(3)
            at = at.reshape(len(at), stiffnesses.shape[1])
            index = (at[:, :, None] * width + at[:, None]).ravel()
            matrix += np.bincount(index, stiffnesses.ravel(), width * width)
        return matrix.reshape(width, width)

    def _eliminate(self, layer, nodes, matrix, own, later, rest):
        """Change the matrix and what rests of the loads; the work of the loads on what is gone."""
        freedoms = (3 * nodes[:, None] + np.arange(3)).ravel()
        across, loads = matrix[own, later], rest[freedoms[own]]
        solved = np.linalg.solve(matrix[own, own], np.concatenate([loads, across], axis=1))
        matrix[later, later] -= across.T @ solved[:, self._loads :]
        rest[freedoms[later]] -= across.T @ solved[:, : self._loads]
        self._steps.append((layer, freedoms[own], freedoms[later], solved))
        return loads.T @ solved[:, : self._loads]
