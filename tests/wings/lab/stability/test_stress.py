"""Stress cases: each is what it says, and the same seed gives the same."""

import numpy as np
import pytest

from deformrf.core.deform import lumped_masses
from deformrf.core.geometry import a15_grid, signed_volumes, tet_neighbours
from deformrf.wings.lab.stability import stress

MESH = a15_grid(0.125)
REST, TETS = MESH.rest_vertices, MESH.tets


@pytest.mark.parametrize("start, dimensions", [("plane", 2), ("line", 1), ("point", 0)])
def test_a_collapsed_body_has_lost_its_dimensions(start, dimensions):
    x = stress.STARTS[start](REST, np.random.default_rng())
    extents = np.ptp(x, axis=0)
    assert (extents[:dimensions] == np.ptp(REST, axis=0)[:dimensions]).all()
    assert (extents[dimensions:] == 0.0).all()
    assert (signed_volumes(x, TETS) == 0.0).all()


def test_a_mirrored_body_has_its_lengths_and_is_inside_out():
    x = stress.STARTS["mirrored"](REST, np.random.default_rng())
    np.testing.assert_allclose(signed_volumes(x, TETS), -signed_volumes(REST, TETS))
    assert np.linalg.norm(x - REST, axis=1).max() > 0.5


def test_random_vertices_stay_in_the_box():
    x = stress.random(REST, np.random.default_rng(7))
    assert (x >= REST.min(axis=0)).all() and (x <= REST.max(axis=0)).all()
    inverted = (signed_volumes(x, TETS) < 0).mean()
    assert 0.4 < inverted < 0.6
    np.testing.assert_array_equal(x, stress.random(REST, np.random.default_rng(7)))


def test_broken_tets_are_inverted_flat_and_massless():
    rest, tets = stress.with_broken_tets(REST, TETS, np.random.default_rng())
    assert rest.shape == (len(REST) + 1, 3) and tets.shape == (len(TETS) + 2, 4)
    tet_neighbours(tets)  # still a manifold
    volumes = signed_volumes(rest, tets)
    assert (volumes < -1e-6).sum() >= len(TETS) // 20
    assert (np.abs(volumes) < 1e-12).sum() >= 4
    masses = lumped_masses(rest, tets, 1.0)
    assert 0 < masses[-1] < 0.01 * masses.mean()
    untouched = (rest[:-1] == REST).all(axis=1)
    assert (~untouched).sum() == 2


def test_masses_differ_by_a_million():
    masses = stress.uneven_masses(np.ones(1000), np.random.default_rng())
    assert set(masses) == {1.0, 1e6}
    assert 400 < (masses > 1.0).sum() < 600
