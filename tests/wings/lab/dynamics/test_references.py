"""Equilibrium: closed forms of springs, bars and beams, and the lattice's elastic constants."""

import numpy as np
import pytest
from beams import beam
from scipy import sparse

from deformrf.core.deform import Material
from deformrf.core.geometry import A15, BCC
from deformrf.wings.lab.dynamics.energy import Energy, material_energy
from deformrf.wings.lab.dynamics.references import NoEquilibrium, equilibrium, factorize

YOUNG = 5e5


def spring(stiffness, mass, length):
    return Energy(
        masses=np.full(2, mass),
        edges=np.array([[0, 1]]),
        lengths=np.array([length]),
        stiffnesses=np.array([stiffness]),
        tets=np.empty((0, 4), int),
        volumes=np.empty(0),
        volume_stiffnesses=np.empty(0),
    )


def sag(lattice, spacing, ratio, gravity=0.1):
    """Of a beam's tip, over what beam theory says, without and with shear."""
    body, material = beam(lattice, spacing), Material(YOUNG, ratio)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, material)
    moved, residual = equilibrium(energy, rest, body.clamped, (0, 0, -gravity), tolerance=1e-9)
    assert residual < 1e-9
    fallen = (body.tip(rest) - body.tip(moved))[2]
    bending = body.bending_sag(energy.masses, YOUNG, gravity)
    shear = body.shear_sag(energy.masses, material.shear_modulus, gravity)
    return fallen / bending, fallen / (bending + shear)


def test_a_mass_hangs_on_a_spring():
    """It starts beside and above its support, where the Hessian isn't positive."""
    k, m, length = np.random.default_rng().uniform([10, 0.5, 0.2], [500, 2.0, 2.0])
    start = np.array([[0, 0, 0], [0.3 * length, 0.1 * length, 0.5 * length]])
    held = np.array([True, False])
    vertices, residual = equilibrium(spring(k, m, length), start, held, (0, 0, -9.81))
    np.testing.assert_allclose(vertices[1], [0, 0, -length - m * 9.81 / k], atol=1e-7)
    assert residual < 1e-9


def test_at_rest_there_is_nothing_to_do():
    body = beam(A15, 1 / 16)
    energy = material_energy(body.mesh.rest_vertices, body.mesh.tets, Material())
    rest = body.mesh.rest_vertices
    vertices, _ = equilibrium(energy, rest, body.clamped, (0, 0, 0))
    np.testing.assert_array_equal(vertices, rest)


def test_forces_balance_where_a_beam_hangs_far_down():
    body, material = beam(BCC, 1 / 16), Material(young_modulus=1e5)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, material)
    vertices, residual = equilibrium(energy, rest, body.clamped, (0, 0, -9.81))
    assert (rest - vertices)[:, 2].max() > 0.5  # as long as the beam
    forces = energy.masses[:, None] * [0, 0, -9.81] - energy.gradient(vertices)
    free = ~body.clamped
    assert np.abs(forces[free]).max() < 1e-8 * np.abs(forces).max()
    assert residual < 1e-9


def test_what_cannot_converge_is_named():
    body = beam(A15, 1 / 16)
    energy = material_energy(body.mesh.rest_vertices, body.mesh.tets, Material(young_modulus=1e3))
    with pytest.raises(NoEquilibrium, match="no equilibrium after 2 Newton steps: a residual of"):
        equilibrium(energy, body.mesh.rest_vertices, body.clamped, (0, 0, -9.81), most_steps=2)


@pytest.mark.parametrize("ratio", [0.25, 0.4])
@pytest.mark.parametrize("lattice", [A15, BCC], ids=["a15", "bcc"])
def test_a_pulled_bar_has_youngs_modulus_and_poissons_ratio(lattice, ratio):
    """In its middle half, away from the clamps (Saint-Venant)."""
    body, material = beam(lattice, 1 / 48), Material(YOUNG, ratio)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, material)
    end = rest[:, 0] >= 1.0 - 1e-9
    pulled = rest + np.where(end, 1e-4, 0.0)[:, None] * [1, 0, 0]
    found, _ = equilibrium(energy, pulled, body.clamped | end, (0, 0, 0))
    moved = found - rest
    middle = np.abs(rest[:, 0] - 0.5) < 0.25
    strains = [np.polyfit(rest[middle, axis], moved[middle, axis], 1)[0] for axis in range(3)]
    force = energy.gradient(found)[end, 0].sum()
    assert force / (body.area * strains[0]) == pytest.approx(YOUNG, rel=0.03)
    np.testing.assert_allclose(-np.array(strains[1:]) / strains[0], ratio, atol=0.01)


@pytest.mark.parametrize("ratio", [0.25, 0.35, 0.4])
@pytest.mark.parametrize(("lattice", "off"), [(A15, 0.05), (BCC, 0.1)], ids=["a15", "bcc"])
def test_a_beam_sags_as_beam_theory_says(lattice, off, ratio):
    """With shear (Timoshenko), which is 6 % of it here; tolerances are what was measured."""
    assert sag(lattice, 1 / 48, ratio)[1] == pytest.approx(1.0, abs=off)


def test_the_sag_does_not_drift_with_resolution():
    """From 5k to 39k tets, beside beam theory for the section that the ragged surface leaves."""
    coarse, fine = sag(A15, 1 / 48, 0.25), sag(A15, 1 / 96, 0.25)
    np.testing.assert_allclose(fine, coarse, rtol=0.05)
    assert fine[1] == pytest.approx(1.0, abs=0.02)


def test_an_indefinite_matrix_has_no_factors():
    assert factorize(sparse.csr_array(np.array([[1.0, 2.0], [2.0, 1.0]]))) is None
    assert factorize(sparse.csr_array(np.array([[1.0, 0.0], [0.0, 0.0]]))) is None
