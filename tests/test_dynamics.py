"""Verlet: closed forms, what is conserved, and its order."""

import numpy as np
import pytest

from deformrf.core.deform import Material
from deformrf.core.geometry import A15, BCC
from deformrf.core.lab.dynamics.bodies import ball, beam
from deformrf.core.lab.dynamics.energy import Energy, material_energy
from deformrf.core.lab.dynamics.verlet import Run, highest_frequency, motion

SPRING = Energy(
    masses=np.array([1.0, 0.7]),
    edges=np.array([[0, 1]]),
    lengths=np.array([0.5]),
    stiffnesses=np.array([300.0]),
    tets=np.empty((0, 4), int),
    volumes=np.empty(0),
    volume_stiffnesses=np.empty(0),
)
HELD = np.array([True, False])


@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_a_spring_is_a_damped_oscillator(damping):
    start = np.array([[0, 0, 0], [0.6, 0, 0]])
    found = motion(SPRING, start, HELD, 2.0, damping=damping, step=1e-4)
    omega = np.sqrt(300 / 0.7 - damping**2 / 4)
    swing = np.cos(omega * 2.0) + damping / (2 * omega) * np.sin(omega * 2.0)
    expected = 0.5 + 0.1 * np.exp(-damping) * swing
    np.testing.assert_allclose(found.vertices, [[0, 0, 0], [expected, 0, 0]], atol=2e-6)
    assert found.step == pytest.approx(1e-4)
    if damping == 0.0:
        assert found.energy_drift < 1e-4


def test_a_free_body_falls():
    mesh = ball(BCC, 1 / 4)
    energy = material_energy(mesh.rest_vertices, mesh.tets, Material())
    free = np.zeros(mesh.vertex_count, bool)
    found = motion(energy, mesh.rest_vertices, free, 0.3, gravity=(1.0, 0.0, -9.81))
    expected = mesh.rest_vertices + 0.5 * 0.3**2 * np.array([1.0, 0.0, -9.81])
    np.testing.assert_allclose(found.vertices, expected, atol=1e-10)
    np.testing.assert_allclose(found.velocities - [0.3, 0, -2.943], 0, atol=1e-10)


def test_a_swinging_body_keeps_its_momentum():
    mesh = ball(A15, 1 / 8)
    energy = material_energy(mesh.rest_vertices, mesh.tets, Material())
    start = mesh.rest_vertices * [1.2, 0.9, 1.0]
    start[:, 0] += 0.3 * start[:, 1] ** 2
    found = motion(energy, start, np.zeros(mesh.vertex_count, bool), 0.1)
    momenta = energy.masses[:, None] * found.velocities
    scale = np.abs(momenta).sum()
    np.testing.assert_allclose(momenta.sum(axis=0), 0, atol=1e-12 * scale)
    np.testing.assert_allclose(np.cross(found.vertices, momenta).sum(axis=0), 0, atol=1e-12 * scale)
    assert scale > 1.0


def test_the_self_difference_falls_with_the_square_of_the_step():
    body = beam(A15, 1 / 16)
    energy = material_energy(body.mesh.rest_vertices, body.mesh.tets, Material())
    arguments = energy, body.mesh.rest_vertices, body.clamped, 0.1, (0, 0, -9.81)
    runs = [motion(*arguments, step=step) for step in (2e-4, 1e-4)]
    assert runs[0].self_difference / runs[1].self_difference == pytest.approx(4.0, rel=0.2)
    finest = motion(*arguments, step=2e-5).vertices
    error = np.sqrt(((runs[1].vertices - finest) ** 2).sum(axis=1).mean())
    assert error == pytest.approx(runs[1].self_difference / 3, rel=0.2)


def test_held_vertices_go_to_their_targets():
    body = beam(A15, 1 / 16)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, Material(young_modulus=1e6))
    lifted = rest + np.array([0.0, 0.0, 0.2])
    found = motion(energy, rest, body.clamped, 2.0, damping=8.0, targets=lifted, step=5e-4)
    np.testing.assert_allclose(found.vertices[body.clamped], lifted[body.clamped], atol=1e-12)
    np.testing.assert_allclose(found.vertices, lifted - [0, 0, 0.1 / 8], atol=0.05)  # it lags


def test_the_path_is_that_of_shorter_runs():
    body = beam(BCC, 1 / 8)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, Material())
    whole = motion(energy, rest, body.clamped, 0.1, (0, 0, -9.81), samples=4)
    assert whole.path.shape == (4, *rest.shape)
    np.testing.assert_array_equal(whole.path[-1], whole.vertices)
    half = motion(energy, rest, body.clamped, 0.05, (0, 0, -9.81), step=whole.step)
    np.testing.assert_allclose(whole.path[1], half.vertices, atol=1e-6)


def test_beyond_the_highest_frequency_it_blows_up():
    body = beam(BCC, 1 / 16)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, Material())
    longest = 2.0 / highest_frequency(energy, rest, body.clamped)
    run = Run(energy, rest, rest, ~body.clamped, np.array([0, 0, -9.81]), 0.0)
    for factor, stable in ((0.9, True), (1.2, False)):
        with np.errstate(all="ignore"):
            x, _, _ = run.go(400 * factor * longest, 400, 4)
        assert (np.isfinite(x).all() and np.abs(x).max() < 3.0) == stable
