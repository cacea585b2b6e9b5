"""The published children that the benchmark compares with ours: the supplement's matrices."""

import numpy as np
from descendant_shapes import PUBLISHED_CHILD_VERTICES

from deformrf.core.definition.subdivision import CHILD_VERTICES

# C of DeformRF's supplement: coordinates in child k from those in its parent.
PUBLISHED = np.array(
    [
        [[1, -1, -1, -1], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 2]],
        [[-1, 1, -1, -1], [0, 0, 2, 0], [2, 0, 0, 0], [0, 0, 0, 2]],
        [[-1, -1, 1, -1], [2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 0, 2]],
        [[-1, -1, -1, 1], [2, 0, 0, 0], [0, 0, 2, 0], [0, 2, 0, 0]],
        [[1, 1, -1, -1], [0, 0, 2, 0], [1, -1, -1, 1], [-1, 1, 1, 1]],
        [[1, 1, -1, -1], [1, -1, 1, 1], [0, 0, 0, 2], [-1, 1, 1, -1]],
        [[-1, -1, 1, 1], [1, 1, 1, -1], [0, 2, 0, 0], [1, -1, -1, 1]],
        [[-1, -1, 1, 1], [2, 0, 0, 0], [-1, 1, 1, -1], [1, 1, -1, 1]],
    ]
)


def test_the_published_children_are_the_supplements_matrices():
    parent_from_child = np.eye(4)[PUBLISHED_CHILD_VERTICES].mean(axis=2).swapaxes(1, 2)
    np.testing.assert_allclose(np.linalg.inv(parent_from_child), PUBLISHED, atol=1e-12)


def test_both_orders_have_the_same_eight_regions():
    """Only the order of each child's corners differs."""
    for published, ours in zip(PUBLISHED_CHILD_VERTICES, CHILD_VERTICES, strict=True):
        assert {frozenset(pair) for pair in published} == {frozenset(pair) for pair in ours}
