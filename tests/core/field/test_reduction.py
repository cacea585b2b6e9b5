"""A field with fewer tets has the same values in those that stay."""

import numpy as np
import pytest

from deformrf.core.definition.networks import colors, geometry
from deformrf.core.field import (
    FieldOptions,
    coarsest,
    cut,
    modelfile,
    pack_mask,
    random_field,
    reduced,
    subtet_middles,
    unpack_mask,
    without_specks,
)
from deformrf.core.geometry import a15_grid, tet_neighbours


@pytest.mark.parametrize("dense", [True, False])
def test_what_stays_has_the_density_and_color_it_had(dense):
    rng = np.random.default_rng()
    mesh = a15_grid(0.2)
    options = FieldOptions(level_count=4, table_size=2**13, dense_levels=dense)
    field = random_field(mesh, tet_neighbours(mesh.tets), options, seed=1)
    field.occupancy[:] = rng.integers(0, 2**63, mesh.tet_count, dtype=np.uint64)
    keep = mesh.rest_vertices[mesh.tets].mean(axis=1)[:, 0] < 0.3
    small = reduced(field, keep)
    assert small.mesh.tet_count == keep.sum() < mesh.tet_count
    # Levels that were hashed have room for an entry per vertex now.
    assert small.layout.dense_level_count > field.layout.dense_level_count or not dense
    np.testing.assert_array_equal(small.occupancy, field.occupancy[keep])
    tet = rng.integers(0, keep.sum(), 200)
    bary = rng.dirichlet(np.ones(4), 200)
    directions = rng.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before = geometry(field.definition, np.flatnonzero(keep)[tet], bary)
    after = geometry(small.definition, tet, bary)
    np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-9)
    of_before, of_after = (
        colors(h, directions, of.definition.color_layers)
        for h, of in ((before, field), (after, small))
    )
    np.testing.assert_allclose(of_after, of_before, rtol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_coarse_levels_alone_are_as_if_the_others_were_zero(count, tmp_path):
    rng = np.random.default_rng()
    mesh = a15_grid(0.2)
    options = FieldOptions(level_count=4, table_size=2**13)  # three are dense
    field = random_field(mesh, tet_neighbours(mesh.tets), options, seed=1)
    modelfile.save(coarsest(field, count), tmp_path / "coarse.npz", entry_bits=16)
    coarse = modelfile.load(tmp_path / "coarse.npz")
    assert coarse.options.level_count == coarse.layout.level_count == count
    field.table[field.layout.offsets[count] :] = 0.0
    tet, bary = rng.integers(0, mesh.tet_count, 200), rng.dirichlet(np.ones(4), 200)
    before, after = (geometry(f.definition, tet, bary) for f in (field, coarse))
    np.testing.assert_allclose(after, before, rtol=1e-2, atol=2e-2)  # the file rounds
    after = geometry(coarsest(field, count).definition, tet, bary)
    np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("count", [0, 5])
def test_levels_that_a_field_lacks_are_refused(count):
    mesh = a15_grid(0.25)
    field = random_field(mesh, tet_neighbours(mesh.tets), FieldOptions(level_count=4))
    with pytest.raises(ValueError, match="levels of 4"):
        coarsest(field, count)


def test_something_has_to_stay():
    mesh = a15_grid(0.25)
    field = random_field(mesh, tet_neighbours(mesh.tets), FieldOptions(level_count=2))
    with pytest.raises(ValueError, match="no tet"):
        reduced(field, np.zeros(mesh.tet_count, bool))


@pytest.fixture
def two_balls():
    """A large ball, a small one with 3 % of its matter, and a speck, all in one mesh."""
    mesh = a15_grid(0.04)
    options = FieldOptions(level_count=2, table_size=2**10)
    field = random_field(mesh, tet_neighbours(mesh.tets), options)
    places = subtet_middles(mesh)
    matter = np.zeros(places.shape[:2], bool)
    for center, radius in (
        ([0.3, 0.5, 0.5], 0.25),
        ([0.8, 0.5, 0.5], 0.08),
        ([0.9, 0.9, 0.9], 0.03),
    ):
        matter |= np.linalg.norm(places - center, axis=2) < radius
    field.occupancy[:] = pack_mask(matter)
    return field


def matter_at(field, center, radius=0.3):
    """Occupied sub-tets near a place."""
    places = subtet_middles(field.mesh)[unpack_mask(field.occupancy)]
    return int((np.linalg.norm(places - center, axis=1) < radius).sum())


def test_specks_go_and_smaller_parts_stay(two_balls):
    left = without_specks(two_balls)
    for center, radius in (([0.3, 0.5, 0.5], 0.26), ([0.8, 0.5, 0.5], 0.09)):
        assert matter_at(left, center, radius) == matter_at(two_balls, center, radius) > 0
    assert matter_at(two_balls, [0.9, 0.9, 0.9], 0.1) > matter_at(left, [0.9, 0.9, 0.9], 0.1) == 0
    assert left.mesh.tet_count < two_balls.mesh.tet_count
    assert without_specks(two_balls, 0.0) is two_balls
    assert matter_at(without_specks(two_balls, 0.99), [0.3, 0.5, 0.5]) > 0  # the largest stays


def test_a_box_is_cut_out_or_kept(two_balls):
    box = np.array([[0.6, 0.3, 0.3], [1.0, 0.7, 0.7]])
    kept, dropped = cut(two_balls, box), cut(two_balls, box, keep_inside=False)
    for field, inside in ((kept, True), (dropped, False)):
        places = subtet_middles(field.mesh)[unpack_mask(field.occupancy)]
        assert (((places >= box[0]) & (places <= box[1])).all(axis=1) == inside).all()
    total = unpack_mask(two_balls.occupancy).sum()
    assert unpack_mask(kept.occupancy).sum() + unpack_mask(dropped.occupancy).sum() == total
    with pytest.raises(ValueError, match="nothing of the model"):
        cut(two_balls, box + 5.0)
