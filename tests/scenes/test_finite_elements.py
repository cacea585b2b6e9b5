"""Quadratic tets: they reproduce exact fields, and beams agree with beam theory."""

from itertools import product

import numpy as np
import pytest
from beams import beam
from finite_elements import Solid, quadratic

from deformrf.core.geometry import A15, BCC, KUHN, a15_grid, boundary_faces, tet_neighbours

MODULUS, RATIO, DENSITY = 2e5, 0.3, 900.0
MU = MODULUS / (2 * (1 + RATIO))
LAME = MODULUS * RATIO / ((1 + RATIO) * (1 - 2 * RATIO))


def solid_of(body, levels=1):
    """A Solid of a Beam that is subdivided levels − 1 times."""
    mesh, solid = quadratic(body.mesh.rest_vertices, body.mesh.tets, body.clamped), None
    for _ in range(levels):
        solid = Solid(mesh, LAME, MU, DENSITY, solid)
        mesh = mesh.subdivided()
    return solid


@pytest.fixture
def mesh():
    """Tets of a grid with moved vertices, none of them held."""
    grid = a15_grid(0.25)
    moves = 0.02 * np.random.default_rng().normal(size=grid.rest_vertices.shape)
    return quadratic(grid.rest_vertices + moves, grid.tets, np.zeros(grid.vertex_count, bool))


def test_patch_a_linear_field_has_the_energy_of_its_strain(mesh):
    slope = np.random.default_rng().normal(size=(3, 3))
    strain = (slope + slope.T) / 2
    u = (mesh.nodes @ slope.T + 7.0).ravel()
    density = 0.5 * LAME * np.trace(strain) ** 2 + MU * (strain**2).sum()
    forces = mesh.stiffness(LAME, MU) @ u
    assert 0.5 * u @ forces == pytest.approx(density * mesh.volumes.sum())
    corners = mesh.tets[:, :4]
    faces, _ = boundary_faces(corners, tet_neighbours(corners))
    outside = {tuple(sorted(pair)) for face in faces.tolist() for pair in product(face, face)}
    within = [tuple(pair) not in outside for pair in np.sort(mesh.parents, axis=1).tolist()]
    assert 0 < sum(within) < len(within)
    np.testing.assert_allclose(forces.reshape(-1, 3)[within], 0.0, atol=1e-10 * abs(forces).max())


def test_a_quadratic_field_is_exact(mesh):
    """Bending: u = (x z, 0, −x²/2) has ε_xx = z alone, whose energy is (λ/2 + μ) ∫ z²."""
    x, _, z = mesh.nodes.T
    u = np.stack([x * z, 0 * x, -(x**2) / 2], axis=1).ravel()
    squares = z @ mesh.mass(1.0) @ z
    energy = 0.5 * u @ (mesh.stiffness(LAME, MU) @ u)
    assert energy == pytest.approx((LAME / 2 + MU) * squares)


def test_the_mass_matrix_integrates_products_of_quadratic_functions(mesh):
    """Over a box of cubes, ∫ x² y² is known; moved vertices do not matter for ∫ 1 and ∫ x²."""
    body = beam(KUHN, 1 / 8)
    box = quadratic(body.mesh.rest_vertices, body.mesh.tets, body.clamped)
    low, high = box.nodes.min(axis=0), box.nodes.max(axis=0)
    moments = (high**3 - low**3) / 3
    x, y, z = box.nodes.T
    assert x**2 @ box.mass(2.0) @ y**2 == pytest.approx(
        2.0 * moments[0] * moments[1] * (high[2] - low[2])
    )
    fourth = (high[2] ** 5 - low[2] ** 5) / 5
    area = np.prod((high - low)[:2])
    assert z**2 @ box.mass(1.0) @ z**2 == pytest.approx(fourth * area)
    assert mesh.mass(3.0).sum() == pytest.approx(3.0 * mesh.volumes.sum())


def test_a_rigid_motion_stores_nothing(mesh):
    turn, shift = np.random.default_rng().normal(size=(2, 3))
    u = (np.cross(turn, mesh.nodes) + shift).ravel()
    stiffness = mesh.stiffness(LAME, MU)
    assert np.abs(stiffness @ u).max() < 1e-9 * abs(stiffness).max()


def test_a_slender_beam_sags_and_swings_as_timoshenko_says():
    body = beam(KUHN, 1 / 16, width=1 / 16, length=1.0)
    solid = solid_of(body)
    u = solid.sag([0.0, 0.0, -0.1])
    side, load = 1 / 16, DENSITY * 0.1 / 16**2
    bending = load / (8 * MODULUS * side**4 / 12)
    shear = load / (2 * 5 / 6 * MU * side**2)
    tip = -body.tip(u[: body.mesh.vertex_count])[2]
    # The clamp keeps the section from becoming narrower, which stiffens about one width of it.
    assert tip == pytest.approx(bending + shear, rel=0.02)
    frequency, mode = solid.lowest_mode(u)
    slender = 1.8751041**2 / (2 * np.pi) * np.sqrt(MODULUS * side**2 / 12 / DENSITY)
    assert frequency == pytest.approx(slender, rel=0.02)
    assert np.corrcoef(mode[:, 2], u[:, 2])[0, 1] > 0.99


@pytest.mark.parametrize("lattice", [A15, BCC, KUHN], ids=["a15", "bcc", "kuhn"])
def test_a_finer_mesh_has_the_same_body_and_is_softer(lattice):
    body = beam(lattice, 1 / 16, length=0.5)
    coarse, fine = solid_of(body), solid_of(body, 2)
    assert fine.mesh.volumes.min() > 0
    assert fine.mesh.volumes.sum() == pytest.approx(coarse.mesh.volumes.sum())
    count = len(coarse.mesh.nodes)
    np.testing.assert_array_equal(fine.mesh.nodes[:count], coarse.mesh.nodes)
    np.testing.assert_array_equal(fine.mesh.held[:count], coarse.mesh.held)
    prolong = coarse.mesh.prolongation()
    squares = coarse.mesh.nodes[:, [0]] * coarse.mesh.nodes
    np.testing.assert_allclose(
        prolong @ squares, fine.mesh.nodes[:, [0]] * fine.mesh.nodes, atol=1e-12
    )
    sags = [
        -body.tip(solid.sag([0, 0, -0.1])[: body.mesh.vertex_count])[2] for solid in (coarse, fine)
    ]
    assert sags[0] < sags[1] < 1.1 * sags[0]


def test_conjugate_gradients_agree_with_factors():
    body = beam(A15, 1 / 16, length=0.5)
    fine = solid_of(body, 2)
    u = fine.sag([0.0, 0.0, -0.1])
    direct = Solid(fine.mesh, LAME, MU, DENSITY).sag([0.0, 0.0, -0.1])
    assert np.abs(u - direct).max() < 1e-5 * np.abs(direct).max()
