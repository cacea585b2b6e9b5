"""Which constraints are in use: chosen by color, at fixed capacity."""

import numpy as np
import warp as wp

from deformrf.core.deform import constraints
from deformrf.core.deform.arrays import ConstraintList
from deformrf.core.geometry.lattice import a15_grid

MESH = a15_grid(0.2)


def test_a_selection_keeps_the_colors_apart(device):
    edges = constraints.edge_constraints(MESH.rest_vertices, MESH.tets)
    chosen = ConstraintList(edges, edges.rest_lengths, wp.vec2i, wp.get_device(device))
    capacity = len(chosen.arrays.vertices)
    movable = np.random.default_rng().uniform(size=MESH.vertex_count) < 0.3
    assert chosen.select(movable)
    assert not chosen.select(movable)  # nothing new
    a = np.random.default_rng().uniform(size=capacity)
    chosen.set_regularization(a)

    offsets = chosen.arrays.offsets.numpy()
    count = offsets[-1]
    assert 0 < count < capacity == len(chosen.arrays.vertices)
    np.testing.assert_array_equal(offsets, chosen.offsets)
    ends = chosen.arrays.vertices.numpy()[:count]
    assert movable[ends].any(axis=1).all()
    for color in range(len(offsets) - 1):
        first, last = offsets[color : color + 2]
        begin, end = edges.offsets[color : color + 2]
        here = ends[first:last]
        assert len(np.unique(here)) == here.size
        of_color = edges.vertices[begin:end]
        np.testing.assert_array_equal(here, of_color[movable[of_color].any(axis=1)])
    np.testing.assert_array_equal(ends, edges.vertices[chosen.in_use])
    for array, values in ((chosen.arrays.rest_values, edges.rest_lengths),
                          (chosen.arrays.regularization, a)):  # fmt: skip
        np.testing.assert_array_equal(
            array.numpy()[:count], values[chosen.in_use].astype(np.float32)
        )


def test_nothing_may_be_in_use_and_everything_again(device):
    tets = constraints.volume_constraints(MESH.rest_vertices, MESH.tets)
    chosen = ConstraintList(tets, tets.rest_volumes, wp.vec4i, wp.get_device(device))
    before = chosen.arrays.vertices.numpy().copy()
    assert chosen.select(np.zeros(MESH.vertex_count, bool))
    assert (chosen.arrays.offsets.numpy() == 0).all()
    assert chosen.select(np.ones(MESH.vertex_count, bool))
    np.testing.assert_array_equal(chosen.arrays.vertices.numpy(), before)
    np.testing.assert_array_equal(chosen.arrays.offsets.numpy(), tets.offsets)
