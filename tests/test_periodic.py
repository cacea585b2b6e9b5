"""Lattices that are found again in a trimmed, scaled, shifted mesh."""

import numpy as np
import pytest

from deformrf.core.geometry import A15, BCC, KUHN, extract, lattice_addresses
from deformrf.core.geometry.lattice import grid
from deformrf.core.geometry.periodic import periodic_classes


@pytest.mark.parametrize("lattice", [A15, BCC, KUHN])
def test_a_part_of_a_lattice_is_recognized(lattice):
    random = np.random.default_rng()
    mesh = grid(lattice, 0.08)
    far = np.linalg.norm(mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5, axis=1)
    mesh, _ = extract(mesh, (far < 0.4) & (random.uniform(size=len(far)) < 0.8))
    scale, shift = random.uniform(0.1, 10.0), random.uniform(-5.0, 5.0, 3)
    moved = (scale * mesh.rest_vertices + shift).astype(np.float32).astype(np.float64)
    found, addresses, on_lattice = lattice_addresses(moved)
    assert found is lattice
    assert on_lattice.all()
    # The same as the grid's own, but for a whole number of cells and a symmetry of them.
    differences = np.diff(mesh.addresses.astype(int), axis=0)
    np.testing.assert_array_equal(np.diff(addresses, axis=0), differences)


def test_other_meshes_have_no_lattice():
    random = np.random.default_rng()
    assert lattice_addresses(random.uniform(size=(300, 3))) is None
    assert lattice_addresses(np.zeros((4, 3))) is None
    corners = np.array([[-0.3, -0.3, 0.2], [0.3, -0.3, 0.2], [0.0, 0.4, 0.2], [0, 0, 0.71]])
    assert lattice_addresses(corners) is None


@pytest.mark.parametrize("lattice", [A15, BCC, KUHN])
def test_translates_have_one_class_and_color(lattice):
    mesh = grid(lattice, 0.08)
    corners = mesh.addresses[mesh.tets].astype(np.int64)
    colors, classes = periodic_classes(lattice, corners)
    assert (colors >= 0).all()
    cells = np.random.default_rng().integers(-3, 4, 3)
    moved = periodic_classes(lattice, corners + 4 * cells)  # 4: a period of each of them
    np.testing.assert_array_equal(moved[0], colors)
    np.testing.assert_array_equal(moved[1], classes)
    pairs = np.unique(np.stack([classes, colors], axis=1), axis=0)
    assert len(pairs) == len(np.unique(classes))


def test_what_is_not_of_the_lattice_has_none():
    corners = np.array([[[0, 0, 0], [4, 0, 0]], [[0, 0, 0], [1, 2, 0]]])
    colors, classes = periodic_classes(A15, corners)
    assert colors[0] == classes[0] == -1
    assert colors[1] >= 0 and classes[1] >= 0
