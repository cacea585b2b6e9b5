"""Verlet: closed forms, what is conserved, and its order."""

import numpy as np
import pytest
from beams import ball, beam

from deformrf.core.deform import Material
from deformrf.core.geometry import A15, BCC
from deformrf.core.lab.dynamics.energy import Energy, material_energy
from deformrf.core.lab.dynamics.references import longest_step, motion, verlet

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


def test_a_spring_is_an_oscillator():
    start = np.array([[0, 0, 0], [0.6, 0, 0]])
    found = motion(SPRING, start, HELD, 2.0, step=1e-4)
    expected = 0.5 + 0.1 * np.cos(np.sqrt(300 / 0.7) * 2.0)
    np.testing.assert_allclose(found.path[-1], [[0, 0, 0], [expected, 0, 0]], atol=2e-6)
    assert found.step == pytest.approx(1e-4)
    energy = SPRING.value(found.path[-1]) + 0.5 * 0.7 * (found.velocities[1] ** 2).sum()
    assert energy == pytest.approx(SPRING.value(start), rel=1e-4)


def test_a_free_body_falls():
    mesh = ball(BCC, 1 / 4)
    energy = material_energy(mesh.rest_vertices, mesh.tets, Material())
    free = np.zeros(mesh.vertex_count, bool)
    found = motion(energy, mesh.rest_vertices, free, 0.3, gravity=(1.0, 0.0, -9.81))
    expected = mesh.rest_vertices + 0.5 * 0.3**2 * np.array([1.0, 0.0, -9.81])
    np.testing.assert_allclose(found.path[-1], expected, atol=1e-10)
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
    np.testing.assert_allclose(np.cross(found.path[-1], momenta).sum(axis=0), 0, atol=1e-12 * scale)
    assert scale > 1.0


def test_the_self_difference_falls_with_the_square_of_the_step():
    body = beam(A15, 1 / 16)
    energy = material_energy(body.mesh.rest_vertices, body.mesh.tets, Material())
    arguments = energy, body.mesh.rest_vertices, body.clamped, 0.1, (0, 0, -9.81)
    runs = [motion(*arguments, step=step) for step in (2e-4, 1e-4)]
    assert runs[0].self_difference / runs[1].self_difference == pytest.approx(4.0, rel=0.2)
    finest = motion(*arguments, step=2e-5).path
    error = np.sqrt(((runs[1].path[-1] - finest[-1]) ** 2).sum(axis=1).mean())
    assert error == pytest.approx(runs[1].self_difference / 3, rel=0.2)


def test_the_path_is_that_of_shorter_runs():
    body = beam(BCC, 1 / 8)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, Material())
    whole = motion(energy, rest, body.clamped, 0.1, (0, 0, -9.81), samples=4)
    assert whole.path.shape == (4, *rest.shape)
    half = motion(energy, rest, body.clamped, 0.05, (0, 0, -9.81), step=whole.step)
    np.testing.assert_allclose(whole.path[1], half.path[-1], atol=1e-6)


def test_beyond_the_highest_frequency_it_blows_up():
    body = beam(BCC, 1 / 16)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, Material())
    longest = longest_step(energy, rest, body.clamped)
    for factor, stable in ((0.9, True), (1.2, False)):
        with np.errstate(all="ignore"):
            duration = 400 * factor * longest
            x, _ = verlet(energy, rest, body.clamped, duration, (0, 0, -9.81), 400, 4)
        assert (np.isfinite(x).all() and np.abs(x).max() < 3.0) == stable
