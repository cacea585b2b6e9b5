"""What tests/benchmarks/dynamics.py measures is right where the answer is known."""

import math

import dynamics
import numpy as np
import pytest
from elastic_bodies import AWAKE, cantilever, energy_of, free, held_beam, load, make_solver, modes

from deformrf.core.deform import Material

MANY = 100  # substeps: numerical damping and softening are small


@pytest.fixture(scope="module")
def beam():
    return cantilever(1 / 16)  # 176 tets


def test_modes_swing_at_their_frequencies(beam):
    """The forces of a mode's shape are ω² times its vertices' masses, and its mass is 1."""
    body, asked = held_beam(beam), 3.0
    energy = energy_of(body, Material())
    omegas, shapes = modes(body, energy, asked)
    hessian, masses = energy.hessian(body.rest), energy.masses[:, None]
    for omega, shape in zip(omegas, shapes, strict=True):
        forces = (hessian @ shape.ravel()).reshape(-1, 3)
        np.testing.assert_allclose(
            forces[~body.held], (omega**2 * masses * shape)[~body.held], atol=1e-6 * omega**2
        )
    products = np.einsum("v,avi,bvi", energy.masses, shapes, shapes)
    np.testing.assert_allclose(products, np.eye(len(omegas)), atol=1e-9)
    away = np.abs(omegas / (2.0 * math.pi) - asked)
    assert away[0] == away.min()


def test_damping_adds_half_of_itself_to_the_decay_of_a_mode(beam):
    body, rates = held_beam(beam), []
    for damping in (0.0, 2.0):
        material = Material(damping=damping)
        energy = energy_of(body, material)
        solver = make_solver(body, material, MANY, "cpu", **AWAKE)
        rates.append(dynamics.decay(solver, energy.masses, *modes(body, energy, 1.0)))
    assert rates[1] - rates[0] == pytest.approx(1.0, rel=0.03)


def test_a_body_in_free_flight_has_the_angular_momentum_of_its_inertia(beam):
    body, material = free(held_beam(beam)), Material(damping=0.0)
    masses = energy_of(body, material).masses[:, None]
    away = body.rest - (masses * body.rest).sum(axis=0) / masses.sum()
    solver = make_solver(body, material, MANY, "cpu", **AWAKE)
    velocities = np.cross([0.0, 0.0, 3.0], away)
    velocities[:, 0] += 5.0
    solver.set_state(body.rest, velocities)
    inertia = (masses * away[:, :2] ** 2).sum()
    np.testing.assert_allclose(
        dynamics.angular_momentum(solver, masses)[2], 3.0 * inertia, rtol=1e-4
    )


@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0)], ids=["bend", "pull"])
def test_many_substeps_measure_the_modulus_that_was_asked_for(beam, direction, monkeypatch):
    monkeypatch.setattr(dynamics, "MODULI", (1e5,))
    setup = dynamics.Setup("cpu", "helmet", (MANY,), quick=False)
    rows = dynamics.moduli(setup, "bending", "beam", held_beam(beam), direction)
    for row in rows:
        assert row.measured == pytest.approx(1.0, abs=0.01)


def test_what_nothing_moves_sleeps_and_what_falls_on_does_not(beam):
    body = held_beam(beam)
    asleep = make_solver(body, Material(), 10, "cpu", gravity=(0.0, 0.0, -1e-9))
    assert dynamics.seconds_to_sleep(asleep, 1.0) == pytest.approx(0.5, abs=0.05)
    falls = make_solver(free(body), Material(), 10, "cpu", gravity=(0.0, 0.0, -9.81))
    assert dynamics.seconds_to_sleep(falls, 1.0) == math.inf
    assert dynamics.run(falls, 0.1)[0] == pytest.approx(9.81 / 60.0 + 9.81 / 7200.0, rel=0.02)


def test_a_load_moves_a_linear_body_by_the_share_asked_for(beam):
    case = load(held_beam(beam), "static", (0.0, 1.0, 0.0), 0.01)
    size = np.ptp(case.body.rest, axis=0).max()
    assert np.linalg.norm(case.response, axis=1).max() == pytest.approx(0.01 * size)
