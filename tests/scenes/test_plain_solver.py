"""Positions kept as plain float32: right with few substeps, lost in rounding with many."""

import numpy as np
from beams import beam
from plain_solver import PlainSolver

from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver, lumped_masses
from deformrf.core.geometry import A15


def test_few_substeps_are_the_solver_s():
    body = beam(A15, 1 / 16)
    options = XpbdOptions(substep_count=3, gravity=(0.5, 0.0, -9.81), sleep_motion=0.0)
    common = body.mesh.rest_vertices, body.mesh.tets, Material(), body.clamped, options
    plain, solver = PlainSolver(*common), XpbdSolver(*common)
    for _ in range(10):
        plain.step(TIME_STEP)
        solver.step(TIME_STEP)
    moved = np.abs(solver.vertices.numpy() - body.mesh.rest_vertices).max()
    assert np.abs(plain.vertices.numpy() - solver.vertices.numpy()).max() < 1e-3 * moved


def test_a_soft_push_drowns_in_rounding():
    """Gravity of g moves a vertex by g h² in a substep: below 6e-8 of x it moves nothing."""
    vertices = np.array([[0.5, 0.5, 0.5], [0.8, 0.5, 0.5], [0.5, 0.8, 0.5], [0.5, 0.5, 0.8]])
    tets = np.array([[0, 1, 2, 3]])
    g, count = 0.02, 100  # g h² = 5.6e-10 m
    options = XpbdOptions(substep_count=count, gravity=(0.0, 0.0, -g), sleep_motion=0.0)
    common = vertices, tets, Material(damping=0.0), np.zeros(4, bool), options
    assert (lumped_masses(vertices, tets, 1.0) > 0).all()
    plain, solver = PlainSolver(*common), XpbdSolver(*common)
    for _ in range(6):
        plain.step(TIME_STEP)
        solver.step(TIME_STEP)
    fallen = 0.5 * g * (6 * TIME_STEP) ** 2
    away = (vertices - solver.vertices.numpy())[:, 2]
    np.testing.assert_allclose(away, fallen, rtol=0.02)
    assert np.abs((vertices - plain.vertices.numpy())[:, 2] - fallen).max() > 0.5 * fallen
