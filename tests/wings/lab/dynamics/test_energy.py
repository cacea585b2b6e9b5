"""Energy: differences of differences, what rigid motions cost, and the solid it stands for."""

import numpy as np
import pytest
from beams import ball
from hanging_beams import EvenSprings

from deformrf.core.deform import Material
from deformrf.core.geometry import A15, BCC, a15_grid, signed_volumes
from deformrf.wings.lab.dynamics.energy import Energy, material_energy
from deformrf.wings.lab.dynamics.measure import HeldMesh


@pytest.fixture
def random():
    return np.random.default_rng()


@pytest.fixture
def bent(random):
    """An energy with volumes, and positions far from rest."""
    mesh = ball(BCC, 1 / 4)
    material = Material(young_modulus=random.uniform(1e3, 1e5), poisson_ratio=0.4)
    energy = material_energy(mesh.rest_vertices, mesh.tets, material)
    return energy, mesh.rest_vertices + random.normal(scale=0.05, size=mesh.rest_vertices.shape)


def test_the_gradient_is_a_difference_of_energies(bent, random):
    energy, x = bent
    for _ in range(5):
        way = random.normal(size=x.shape)
        step = 1e-6
        change = (energy.value(x + step * way) - energy.value(x - step * way)) / (2 * step)
        assert (energy.gradient(x) * way).sum() == pytest.approx(change, rel=1e-6)


def test_the_hessian_is_a_difference_of_gradients(bent, random):
    energy, x = bent
    hessian = energy.hessian(x)
    assert abs(hessian - hessian.T).max() <= 1e-12 * abs(hessian).max()
    for _ in range(5):
        way, step = random.normal(size=x.shape), 1e-6
        change = (energy.gradient(x + step * way) - energy.gradient(x - step * way)) / (2 * step)
        expected = change.ravel()
        atol = 1e-7 * np.abs(expected).max()
        np.testing.assert_allclose(hessian @ way.ravel(), expected, atol=atol)


def test_one_inverted_tet_too(random):
    """Far from rest all terms of a volume's Hessian matter."""
    x = random.normal(size=(4, 3))
    energy = Energy(
        masses=np.ones(4),
        edges=np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]),
        lengths=random.uniform(0.5, 2.0, 6),
        stiffnesses=random.uniform(0.5, 2.0, 6),
        tets=np.array([[0, 1, 2, 3]]),
        volumes=np.array([random.normal()]),
        volume_stiffnesses=np.array([3.0]),
    )
    hessian = energy.hessian(x).toarray()
    for index in range(12):
        step = np.zeros(12)
        step[index] = 1e-6
        step = step.reshape(4, 3)
        change = (energy.gradient(x + step) - energy.gradient(x - step)) / 2e-6
        np.testing.assert_allclose(hessian[index], change.ravel(), atol=1e-6 * abs(hessian).max())


def test_rigid_motions_cost_nothing(random):
    mesh = ball(A15, 1 / 8)
    energy = material_energy(mesh.rest_vertices, mesh.tets, Material())
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = mesh.rest_vertices @ turn.T + random.normal(size=3)
    pulled = energy.value(1.01 * mesh.rest_vertices)
    assert energy.value(moved) < 1e-20 * pulled
    assert np.abs(energy.gradient(moved)).max() < 1e-9 * pulled


def test_forces_and_torques_inside_add_up_to_nothing(bent):
    energy, x = bent
    forces = energy.gradient(x)
    np.testing.assert_allclose(forces.sum(axis=0), 0, atol=1e-10 * np.abs(forces).max())
    np.testing.assert_allclose(np.cross(x, forces).sum(axis=0), 0, atol=1e-9 * np.abs(forces).max())


@pytest.mark.parametrize("ratio", [0.25, 0.4])
def test_a_stretched_lattice_stores_the_energy_of_a_solid(ratio, random):
    """Any small strain of a block, but for its surface: ½ λ tr² ε + μ ε : ε."""
    mesh = a15_grid(0.05)
    material = Material(poisson_ratio=ratio)
    energy = material_energy(mesh.rest_vertices, mesh.tets, material)
    strain = 1e-4 * random.normal(size=(3, 3))
    strain = strain + strain.T
    stored = energy.value(mesh.rest_vertices @ (np.eye(3) + strain))
    mu = material.shear_modulus
    lam = material.bulk_modulus + mu
    density = 0.5 * lam * np.trace(strain) ** 2 + mu * (strain**2).sum()
    volume = signed_volumes(mesh.rest_vertices, mesh.tets).sum()
    assert stored == pytest.approx(density * volume, rel=0.05)


def test_uniform_compliance_is_the_same_everywhere():
    mesh = ball(BCC, 1 / 4)
    body = HeldMesh(mesh.rest_vertices, mesh.tets, np.zeros(mesh.vertex_count, bool))
    solid = Material(density=700.0)
    energy = EvenSprings(body, "static", (0.0, 0.0, 0.0), solid, compliance=1e-3).energy
    stretch = 0.01 * energy.lengths
    assert energy.value(1.01 * mesh.rest_vertices) == pytest.approx(500 * (stretch**2).sum())
    volume = signed_volumes(mesh.rest_vertices, mesh.tets).sum()
    assert energy.masses.sum() == pytest.approx(700 * volume)
