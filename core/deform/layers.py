"""Solve a body that is clamped at one end, for every depth of the clamp at once.

Each node is in a layer, by its distance from the clamp.  From the free end on, the layers are
eliminated one by one: S_l is what is then left of the matrix of layer l, and F_l of its loads.
Where the layers up to l are held, the work of the loads is the sum of F_kᵀ S_k⁻¹ F_k over the
layers k > l.

A layer is eliminated as in a multifrontal factorization by nested dissection.  Its elements are
halved by their places, again and again.  Each half eliminates the nodes that no other element
has, and is an element from then on.

Shapes: N nodes, M elements of K nodes, L loads, P clamps: P + 1 is the number of layers.
"""

import numpy as np

FLOOR = 1e-12  # of the mean trace of an element: what turns about a hinge is stiff, too
SMALLEST_HALF = 100  # nodes: below that, halves cost more than they save


class Layers:
    """A body whose layers are eliminated.

    Attributes:
        works: W_ij = F_i · u_j, where the layers 0, 0 to 1, … are held.  [P, L, L]
    """

    def __init__(self, places, layers, elements, loads):
        """
        Args:
            places: Of the nodes.  [N, 3]
            layers: Of each node.  [N] int
            elements: Of each kind the nodes [M, K] and stiffnesses [M, 3K, 3K].
            loads: Forces on the nodes.  [N, 3, L]
        """
        self._places = places
        self._size, _, self._loads = loads.shape
        self._steps = []  # layer, its degrees of freedom, those they act on, solved [·, L + ·]
        self._floor = FLOOR * np.mean(np.concatenate([k.trace(0, 1, 2) for _, k in elements]))
        self._rest = loads.reshape(-1, self._loads).copy()
        kinds = [(*kind, layers[kind[0]].max(axis=1)) for kind in elements]
        works = [np.zeros((self._loads, self._loads))]
        passed = []
        for layer in range(layers.max(), 0, -1):
            inner = layers == layer
            for nodes, _ in passed:
                inner[nodes] = False
            own = [(nodes[of == layer], k[of == layer]) for nodes, k, of in kinds]
            work, front = self._condensed(layer, own, inner)
            more, front = self._merged(layer, [*passed, front], layers == layer)
            works.append(works[-1] + work + more)
            passed = [front]
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

    def _condensed(self, layer, elements, inner):
        """The work of the loads on the inner nodes of these elements, and what remains of these.

        Args:
            inner: Which nodes no other element has.  [N] bool

        Returns:
            [L, L]; nodes and matrix of one element that has the others' work.
        """
        used = np.unique(np.concatenate([nodes.ravel() for nodes, _ in elements]))
        if inner[used].sum() < SMALLEST_HALF:
            return self._merged(layer, elements, inner)
        axis = np.ptp(self._places[used], axis=0).argmax()
        middle = np.median(self._places[used[inner[used]], axis])
        halves, counts = [], np.zeros(self._size, int)
        for first in True, False:
            half = []
            for nodes, stiffnesses in elements:
                chosen = (self._places[nodes, axis].mean(axis=1) < middle) == first
                half.append((nodes[chosen], stiffnesses[chosen]))
            if not sum(len(nodes) for nodes, _ in half):
                return self._merged(layer, elements, inner)
            counts[np.unique(np.concatenate([nodes.ravel() for nodes, _ in half]))] += 1
            halves.append(half)
        own = inner & (counts == 1)
        if not own.any():
            return self._merged(layer, elements, inner)
        work, condensed = 0.0, []
        for half in halves:
            of_half, front = self._condensed(layer, half, own)
            work = work + of_half
            condensed.append(front)
        of_both, front = self._merged(layer, condensed, inner)
        return work + of_both, front

    def _merged(self, layer, elements, inner):
        """The same of elements of any kinds, at once."""
        nodes = np.unique(np.concatenate([each.ravel() for each, _ in elements]))
        nodes = nodes[np.argsort(~inner[nodes], kind="stable")]
        count = 3 * inner[nodes].sum()
        matrix = self._assembled(nodes, elements)
        matrix[np.diag_indices(count)] += self._floor
        freedoms = (3 * nodes[:, None] + np.arange(3)).ravel()
        own, later = freedoms[:count], freedoms[count:]
        across, loads = matrix[:count, count:], self._rest[own]
        solved = np.linalg.solve(matrix[:count, :count], np.concatenate([loads, across], axis=1))
        left = matrix[count:, count:] - across.T @ solved[:, self._loads :]
        self._rest[later] -= across.T @ solved[:, : self._loads]
        self._steps.append((layer, own, later, solved))
        return loads.T @ solved[:, : self._loads], (nodes[count // 3 :], left)

    def _assembled(self, nodes, elements):
        """The matrix of some elements, for these nodes."""
        place = np.zeros(self._size, int)
        place[nodes] = np.arange(len(nodes))
        width = 3 * len(nodes)
        matrix = np.zeros((width, width))
        for of_elements, stiffnesses in elements:
            at = 3 * place[of_elements][..., None] + np.arange(3)
            at = at.reshape(stiffnesses.shape[:-1])
            if at.ndim == 1:
                matrix[np.ix_(at, at)] += stiffnesses
            else:
                index = (at[:, :, None] * width + at[:, None]).ravel()
                np.add.at(matrix.reshape(-1), index, stiffnesses.ravel())
        return matrix
