"""Iterations with stored multipliers: one is a substep, many are implicit Euler."""

import numpy as np
import pytest
from beams import beam
from iteration_solver import IterationSolver

from deformrf.core.deform import COMPLIANCE_FLOOR, Material, XpbdOptions, XpbdSolver
from deformrf.core.geometry import A15, BCC
from deformrf.wings.lab.dynamics.energy import material_energy

DT = 1.0 / 60.0
OPTIONS = XpbdOptions(substep_count=1, gravity=(0.0, 1.0, -9.81), sleep_motion=0.0, rescue=False)


def arguments(lattice, material):
    body = beam(lattice, 1 / 16)
    rest = body.mesh.rest_vertices
    return rest, body.mesh.tets, material, body.clamped, OPTIONS


def positions(solver):
    return solver.vertices.numpy().astype(np.float64)


@pytest.mark.parametrize("ratio", [0.25, 0.4])
def test_one_iteration_is_one_substep(device, ratio):
    common = arguments(A15, Material(poisson_ratio=ratio))
    one = IterationSolver(*common, iteration_count=1, floor=COMPLIANCE_FLOOR, device=device)
    solver = XpbdSolver(*common, device=device)
    for _ in range(20):
        one.step(DT)
        solver.step(DT)
    np.testing.assert_allclose(positions(one), positions(solver), atol=2e-5)
    assert np.abs(positions(one) - common[0]).max() > 0.1


@pytest.mark.parametrize("ratio", [0.25, 0.4])
def test_many_iterations_solve_implicit_euler(device, ratio):
    """m (x − x̂)/h² + ∂energy/∂x = 0, whatever their number: multipliers are stored."""
    common = arguments(BCC, Material(young_modulus=1e6, poisson_ratio=ratio))
    rest, tets, material, clamped, options = common
    energy, residuals = material_energy(rest, tets, material), []
    for count in (10, 100, 400):
        solver = IterationSolver(*common, iteration_count=count, floor=0.0, device=device)
        solver.step(DT)
        x = positions(solver)
        inertial = rest + DT**2 * np.array(options.gravity)
        forces = energy.masses[:, None] * (x - inertial) / DT**2 + energy.gradient(x)
        loads = energy.masses[:, None] * options.gravity
        residuals.append(np.linalg.norm(forces[~clamped]) / np.linalg.norm(loads[~clamped]))
    assert residuals[0] > 1.0
    assert residuals[1] < 0.5 * residuals[0]
    assert residuals[2] < 0.02  # float32 leaves 0.004


def test_given_compliances_replace_the_materials(device):
    material = Material(young_modulus=1e4, poisson_ratio=0.4)
    common, places = arguments(A15, material), []
    solvers = [
        IterationSolver(*common, iteration_count=50, floor=0.0, device=device) for _ in range(5)
    ]
    own = solvers[0]
    solvers[1].set_compliances(
        own.edges.compliances(material.shear_modulus),
        own.volumes.compliances(material.bulk_modulus),
    )
    for solver, alpha in zip(solvers[2:], (1e-4, 1e-6, 0.0), strict=True):
        solver.set_compliances(alpha, None)
    for solver in solvers:
        for _ in range(10):
            solver.step(DT)
        places.append(positions(solver))
    np.testing.assert_array_equal(places[1], places[0])
    fallen = [(common[0] - x)[:, 2].max() for x in places[2:]]
    assert fallen[0] > 1.5 * fallen[1] and fallen[1] > fallen[2]
