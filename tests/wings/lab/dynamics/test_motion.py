"""Verlet: closed forms, what is conserved, and its order."""

import numpy as np
import pytest
from beams import ball, beam

from deformrf.core.deform import Material
from deformrf.core.geometry import A15, BCC
from deformrf.wings.lab.dynamics.energy import Energy, material_energy
from deformrf.wings.lab.dynamics.references import longest_step, motion, verlet

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
    path, velocities = verlet(SPRING, start, HELD, (0, 0, 0), 2.0, 20_000, 1)
    expected = 0.5 + 0.1 * np.cos(np.sqrt(300 / 0.7) * 2.0)
    np.testing.assert_allclose(path[-1], [[0, 0, 0], [expected, 0, 0]], atol=2e-6)
    energy = SPRING.value(path[-1]) + 0.5 * 0.7 * (velocities[1] ** 2).sum()
    assert energy == pytest.approx(SPRING.value(start), rel=1e-4)


def test_a_free_body_falls():
    mesh = ball(BCC, 1 / 4)
    energy = material_energy(mesh.rest_vertices, mesh.tets, Material())
    free = np.zeros(mesh.vertex_count, bool)
    gravity = 1.0, 0.0, -9.81
    path, velocities = verlet(energy, mesh.rest_vertices, free, gravity, 0.3, 2000, 1)
    expected = mesh.rest_vertices + 0.5 * 0.3**2 * np.array(gravity)
    np.testing.assert_allclose(path[-1], expected, atol=1e-10)
    np.testing.assert_allclose(velocities - [0.3, 0, -2.943], 0, atol=1e-10)


def test_a_swinging_body_keeps_its_momentum():
    mesh = ball(A15, 1 / 8)
    energy = material_energy(mesh.rest_vertices, mesh.tets, Material())
    start = mesh.rest_vertices * [1.2, 0.9, 1.0]
    start[:, 0] += 0.3 * start[:, 1] ** 2
    free = np.zeros(mesh.vertex_count, bool)
    path, velocities = verlet(energy, start, free, (0, 0, 0), 0.1, 1000, 1)
    momenta = energy.masses[:, None] * velocities
    scale = np.abs(momenta).sum()
    np.testing.assert_allclose(momenta.sum(axis=0), 0, atol=1e-12 * scale)
    np.testing.assert_allclose(np.cross(path[-1], momenta).sum(axis=0), 0, atol=1e-12 * scale)
    assert scale > 1.0


def test_the_error_is_a_third_of_the_difference_to_the_double_step():
    """And falls with the square of the step."""
    body = beam(A15, 1 / 16)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, Material())
    gravity = 0, 0, -9.81
    runs = [
        verlet(energy, rest, body.clamped, gravity, 0.1, count, 2)[0]
        for count in (500, 1000, 10_000)
    ]
    coarse, fine = (np.sqrt(((run - runs[2]) ** 2).sum(axis=2).mean()) for run in runs[:2])
    assert coarse / fine == pytest.approx(4.0, rel=0.1)
    path, error = motion(energy, rest, body.clamped, gravity, 0.1, 2)
    found = np.sqrt(((path - runs[2]) ** 2).sum(axis=2).mean())
    assert error == pytest.approx(found, rel=0.1)


def test_the_path_is_that_of_shorter_runs():
    body = beam(BCC, 1 / 8)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, Material())
    whole, _ = motion(energy, rest, body.clamped, (0, 0, -9.81), 0.1, 4)
    assert whole.shape == (4, *rest.shape)
    half, _ = motion(energy, rest, body.clamped, (0, 0, -9.81), 0.05, 1)
    np.testing.assert_allclose(whole[1], half[-1], atol=1e-6)


def test_beyond_the_highest_frequency_it_blows_up():
    body = beam(BCC, 1 / 16)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, Material())
    longest = longest_step(energy, rest, body.clamped)
    for factor, stable in ((0.9, True), (1.2, False)):
        with np.errstate(all="ignore"):
            duration = 400 * factor * longest
            x, _ = verlet(energy, rest, body.clamped, (0, 0, -9.81), duration, 400, 4)
        assert (np.isfinite(x).all() and np.abs(x).max() < 3.0) == stable
