"""A field with fewer tets has the same values in those that stay."""

import numpy as np
import pytest

from deformrf.core.field import FieldOptions, random_field, reduced
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
    before = field.evaluate(np.flatnonzero(keep)[tet], bary, directions)
    after = small.evaluate(tet, bary, directions)
    for a, b in zip(after, before, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9)


def test_something_has_to_stay():
    mesh = a15_grid(0.25)
    field = random_field(mesh, tet_neighbours(mesh.tets), FieldOptions(level_count=2))
    with pytest.raises(ValueError, match="no tet"):
        reduced(field, np.zeros(mesh.tet_count, bool))
