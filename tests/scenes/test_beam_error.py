"""The solver's error: closed form of one spring, and floors on beams under gravity."""

from dataclasses import replace

import numpy as np
import pytest
from hanging_beams import beam_case

from deformrf.core.deform import (
    FIRST_INTEGRATOR,
    TIME_STEP,
    Material,
    XpbdOptions,
    XpbdSolver,
    constraints,
    lumped_masses,
)
from deformrf.wings.lab.dynamics.measure import MOTION_FRAMES, measure

FLOORS = {20: 5.0, 50: 1.0}  # of the RMS error, by substeps [% of the size]


@pytest.mark.parametrize("substeps", [10, 20, 50])
def test_one_spring_loses_energy_as_backward_euler_does(device, substeps):
    """A factor of 1/(1 + ω²h²) a substep, about exp(−ω² h t), and the frequency atan(ωh)/h."""
    vertices = np.array([[-0.3, -0.3, 0], [0.3, -0.3, 0], [0, 0.4, 0], [0, 0, 0.5]])
    vertices -= vertices[0]  # along the spring, its length has few roundings
    tets = np.array([[0, 1, 2, 3]])
    material = Material(damping=0.0)
    options = XpbdOptions(
        substep_count=substeps, sleep_motion=0.0, rescue=False, integrator=FIRST_INTEGRATOR
    )
    pinned = np.array([True, True, True, False])
    solver = XpbdSolver(vertices, tets, material, pinned, options, device)
    springs = (solver.edges.vertices == [0, 3]).all(axis=1)
    mass = lumped_masses(vertices, tets, material.density)[3]
    omega = 31.6
    solver.set_compliances(np.where(springs, 1.0 / (mass * omega**2), 1e9), None)
    along = vertices[3] / np.linalg.norm(vertices[3])
    start = vertices.copy()
    start[3] += 2e-3 * along
    solver.set_state(start)
    frames = 120
    for _ in range(frames):
        solver.step(TIME_STEP)
    stretch = (solver.vertices.numpy()[3] - vertices[3]) @ along
    speed = solver.velocities.numpy()[3] @ along
    left = (speed**2 + (omega * stretch) ** 2) / (omega * 2e-3) ** 2
    h, count = TIME_STEP / substeps, frames * substeps
    assert left == pytest.approx((1 + (omega * h) ** 2) ** -count, rel=0.01)
    assert left == pytest.approx(np.exp(-(omega**2) * h * frames * TIME_STEP), rel=0.12)
    angle = count * np.arctan(omega * h)
    amplitude = 2e-3 * (1 + (omega * h) ** 2) ** (-count / 2)
    assert stretch == pytest.approx(amplitude * np.cos(angle), abs=0.02 * amplitude)


@pytest.mark.parametrize("lattice", ["a15", "bcc"])
@pytest.mark.parametrize("compliance", [0.0, 1e-4, None])
def test_a_settled_beam_is_as_exact_as_owed(device, lattice, compliance):
    case = beam_case(lattice, 1 / 32, compliance, "static")
    rms = {n: measure(case, n, device).of_size for n in (20, 50, 100)}
    for count, floor in FLOORS.items():
        assert rms[count] <= floor
    assert rms[50] <= rms[20] / 4 and rms[100] <= rms[50] / 3  # about n^-2


@pytest.mark.parametrize("lattice", ["a15", "bcc"])
def test_float32_is_enough_for_200_substeps(device, lattice):
    case = beam_case(lattice, 1 / 16, None, "static")
    rms = [measure(case, n, device).of_size for n in (50, 100, 200)]
    assert rms[1] <= rms[0] / 3 and rms[2] <= rms[1] / 2


def test_a_falling_beam_follows_verlet(device):
    case = beam_case("a15", 1 / 16, None, "dynamic")
    rows = [measure(case, n, device) for n in (20, 50, 200)]
    assert [row.frames for row in rows] == [MOTION_FRAMES] * 3
    assert rows[0].of_size <= 1.0 and rows[1].of_size <= 0.2 and rows[2].of_size <= 0.05
    assert rows[0].of_motion <= 5.0


@pytest.mark.parametrize("ratio", [0.25, 0.4])
@pytest.mark.parametrize("lattice", ["a15", "bcc", "kuhn"])
def test_the_softening_of_a_sweep_is_made_up_for(lattice, ratio, monkeypatch):
    """The error of a beam that hangs under a load is 7 to 40 times smaller than without."""
    case = beam_case(lattice, 1 / 12, None, "static")
    material = Material(young_modulus=2e5, poisson_ratio=ratio)
    case = replace(case, solid=material, gravity=(0.0, 0.0, -0.3))
    corrected = measure(case, 11, "cpu").of_motion
    monkeypatch.setattr(constraints, "SWEEP_SOFTENING", 0.0)
    monkeypatch.setattr(constraints, "SECOND_SOFTENING", 0.0)
    plain = measure(case, 11, "cpu").of_motion
    assert corrected < 0.2 * plain
    assert plain > 0.2  # percent of the motion
