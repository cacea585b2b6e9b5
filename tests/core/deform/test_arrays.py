"""Lists of the constraints in use: sorted by color, in arrays of fixed size."""

from itertools import pairwise

import numpy as np
import warp as wp

from deformrf.core.deform import constraints
from deformrf.core.deform.arrays import CPU_GROUP, CUDA_GROUP, ConstraintList
from deformrf.core.geometry import a15_grid

MESH = a15_grid(0.2)


def test_a_selection_keeps_colors_separate(device):
    edges = constraints.edge_constraints(MESH.rest_vertices, MESH.tets)
    chosen = ConstraintList(edges, MESH.vertex_count, wp.get_device(device))
    room = len(chosen.arrays.vertices)
    movable = np.random.default_rng().uniform(size=MESH.vertex_count) < 0.3
    chosen.select(movable)
    in_use = chosen.in_use
    chosen.select(movable)
    assert chosen.in_use is in_use  # nothing new
    a = np.random.default_rng().uniform(size=len(edges.vertices))
    chosen.set_regularization(a)

    offsets = chosen.arrays.offsets.numpy()
    group = CUDA_GROUP if device != "cpu" else CPU_GROUP
    assert (offsets % group == 0).all()
    assert 0 < offsets[-1] <= room == len(chosen.arrays.vertices)
    names = "vertices", "ids", "rest_values", "regularization"
    ends, ids, lengths, regularization = (getattr(chosen.arrays, n).numpy() for n in names)
    used = ends[:, 0] < MESH.vertex_count
    np.testing.assert_array_equal(ids[used], chosen.in_use)
    np.testing.assert_array_equal(ends[used], edges.vertices[chosen.in_use])
    np.testing.assert_array_equal(lengths[used], np.float32(edges.rest_values[chosen.in_use]))
    np.testing.assert_array_equal(regularization[used], np.float32(a[chosen.in_use]))
    assert (regularization[~used] == 1).all()
    assert (ends[~used] == MESH.vertex_count).all()
    for color, (first, last) in enumerate(pairwise(offsets)):
        here = ends[first:last][used[first:last]]
        assert len(np.unique(here)) == here.size
        of_color = edges.vertices[slice(*edges.offsets[color : color + 2])]
        np.testing.assert_array_equal(here, of_color[movable[of_color].any(axis=1)])


def test_selecting_nothing_and_then_everything_restores_the_list(device):
    tets = constraints.volume_constraints(MESH.rest_vertices, MESH.tets)
    chosen = ConstraintList(tets, MESH.vertex_count, wp.get_device(device))
    names = "vertices", "ids", "rest_values", "regularization", "offsets"
    arrays = [getattr(chosen.arrays, name) for name in names]
    before = [array.numpy().copy() for array in arrays]
    chosen.select(np.zeros(MESH.vertex_count, bool))
    assert (chosen.arrays.offsets.numpy() == 0).all()
    chosen.select(np.ones(MESH.vertex_count, bool))
    for array, values in zip(arrays, before, strict=True):
        np.testing.assert_array_equal(array.numpy(), values)


def test_colors_without_a_stiff_constraint_are_skipped(device):
    tets = constraints.volume_constraints(MESH.rest_vertices, MESH.tets)
    chosen = ConstraintList(tets, MESH.vertex_count, wp.get_device(device))
    everything = np.ones(MESH.vertex_count, bool)
    all_colors = len(tets.offsets) - 1
    assert chosen.arrays.color_count.numpy() == [all_colors]
    stiff = tets.shares > 0.0
    chosen.select(everything, stiff)
    of = np.repeat(np.arange(all_colors), np.diff(tets.offsets))
    [count] = chosen.arrays.color_count.numpy()
    assert count == len(np.unique(of[stiff])) < all_colors
    ids, offsets = chosen.arrays.ids.numpy(), chosen.arrays.offsets.numpy()
    used = chosen.arrays.vertices.numpy()[:, 0] < MESH.vertex_count
    for color, (first, last) in zip(np.unique(of[stiff]), pairwise(offsets), strict=False):
        mine = ids[first:last][used[first:last]]
        np.testing.assert_array_equal(mine, np.flatnonzero(stiff & (of == color)))
    assert (offsets[count:] == offsets[count]).all()
