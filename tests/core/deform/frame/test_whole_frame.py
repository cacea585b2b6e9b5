"""Frames of the solver against the float64 reference, and the reference against a closed form."""

from dataclasses import replace

import numpy as np
import pytest
import solver_frame

from deformrf.core.deform import INTEGRATORS, Material, XpbdOptions, XpbdSolver, constraints
from deformrf.core.deform.xpbd_options import Timing
from deformrf.core.geometry import a15_grid, extract

DT = 1.0 / 60.0


def pillar():
    """About 500 tets, upright."""
    mesh = a15_grid(0.06)
    middle = mesh.rest_vertices[mesh.tets].mean(axis=1)
    away = np.linalg.norm(middle[:, :2] - 0.5, axis=1)
    return extract(mesh, (away < 0.15) & (middle[:, 2] > 0.2) & (middle[:, 2] < 0.8))[0]


MESH = pillar()
FOOT = MESH.rest_vertices[:, 2] < 0.26
HEAD = np.flatnonzero(MESH.rest_vertices[:, 2] > 0.7)


def random_case():
    """Random options, material and state, and the head's way in two frames."""
    random = np.random.default_rng()
    options = XpbdOptions(
        substep_count=int(random.integers(1, 12)),
        gravity=tuple(random.uniform(-10, 10, 3)),
        ground=random.choice([None, 0.35]),
        friction=random.uniform(0, 2),
        air_drag=random.choice([0.0, 3.0]),
        wind=tuple(random.uniform(-5, 5, 3)),
        speed_limit=random.choice([3.0, 20.0]),
        integrator=str(random.choice(list(INTEGRATORS))),
    )
    material = Material(
        young_modulus=10 ** random.uniform(3, 7),
        poisson_ratio=random.choice([0.25, 0.4]),
        damping=random.uniform(0, 5),
    )
    start = MESH.rest_vertices + random.uniform(-0.01, 0.01, MESH.rest_vertices.shape)
    start = start.astype(np.float32).astype(np.float64)
    velocities = random.normal(size=start.shape)
    way = random.uniform(-0.05, 0.05, (2, 1, 3))
    return options, material, start, velocities, way


def assert_agrees(solver, frame, x, v):
    """Compare the solver after its frame with the reference."""
    x, v = solver_frame.step(frame, x, v)
    np.testing.assert_allclose(solver.vertices.numpy(), x, atol=2e-6)
    h = frame.timing.substep
    np.testing.assert_allclose(solver.velocities.numpy(), v, atol=1e-6 / h, rtol=2e-5)


def make_solver(options, material, device):
    return XpbdSolver(MESH.rest_vertices, MESH.tets, material, FOOT, options, device)


@pytest.mark.parametrize("trial", range(4))
def test_a_frame_with_exact_handles_agrees_with_the_reference(device, trial):
    options, material, start, velocities, way = random_case()
    solver = make_solver(options, material, device)
    solver.set_state(start, velocities)
    solver.grab(HEAD)
    targets = (start + way[0]).astype(np.float32).astype(np.float64)
    solver.move(targets[HEAD])
    solver.step(DT)
    targets[FOOT] = start[FOOT]
    frame = solver_frame.Frame(
        **solver_frame.settings_of(solver, DT), targets=targets, anchors=start
    )
    assert_agrees(solver, frame, start, velocities)


@pytest.mark.parametrize("trial", range(4))
def test_a_frame_of_a_free_body_agrees_with_the_reference(device, trial):
    options, material, start, velocities, _ = random_case()
    nothing = np.zeros(MESH.vertex_count, bool)
    solver = XpbdSolver(MESH.rest_vertices, MESH.tets, material, nothing, options, device)
    solver.set_state(start, velocities)
    solver.step(DT)
    frame = solver_frame.Frame(**solver_frame.settings_of(solver, DT), targets=start, anchors=start)
    parts = None if material.damping == 0.0 else np.zeros(MESH.vertex_count, int)
    assert_agrees(solver, replace(frame, free_parts=parts), start, velocities)


@pytest.mark.parametrize("trial", range(4))
def test_two_frames_with_springs_agree_with_the_reference(device, trial):
    """The second frame's anchors are the first one's targets."""
    options, material, start, velocities, way = random_case()
    random = np.random.default_rng()
    stiffness, limit = random.uniform(10, 1e4, len(HEAD)), 10 ** random.uniform(0, 3, len(HEAD))
    solver = make_solver(options, material, device)
    solver.set_state(start, velocities)
    solver.grab(HEAD, stiffness, limit)
    x, v, anchors, presses = start, velocities, start, None
    for move in way:
        targets = start.copy()
        targets[HEAD] = (start[HEAD] + move).astype(np.float32)
        solver.move(targets[HEAD])
        solver.step(DT)
        frame = solver_frame.Frame(
            **solver_frame.settings_of(solver, DT), targets=targets, anchors=anchors
        )
        springs = np.full((MESH.vertex_count, 2), (constraints.NO_SPRING, 0.0))
        springs[HEAD] = constraints.spring_coefficients(
            stiffness, limit, frame.inverse_masses[HEAD], frame.timing.reach
        )
        frame = replace(frame, springs=springs, presses=presses)
        assert_agrees(solver, frame, x, v)
        x, v = (array.numpy().astype(np.float64) for array in (solver.vertices, solver.velocities))
        anchors, presses = targets, solver._state.presses.numpy().astype(np.float64)


def test_a_spring_alone_follows_backward_eulers_closed_form():
    """One free mass on a spring of stiffness k: x ← (x + h v) / (1 + h² k w)."""
    k, w, h, n = 50.0, 2.0, 0.01, 40
    no_edges = constraints.EdgeConstraints(
        vertices=np.empty((0, 2), np.int32),
        rest_values=np.empty(0),
        rest_gradients_squared=np.empty((0, 2)),
        offsets=np.array([0]),
        classes=np.empty(0),
        volumes=np.empty(0),
        factors=np.empty(0),
        sheet_ratios=None,
    )
    springs = constraints.spring_coefficients([k], [np.inf], np.array([w]), h)
    timing = Timing(h, 1.0, 1e9, 0.0, 0.0, 0.0)
    zero = np.zeros((1, 3))
    frame = solver_frame.Frame(
        timing, n, np.array([w]), zero, zero, no_edges, np.empty(0), springs=springs
    )
    x, v = solver_frame.step(frame, np.array([[1.0, 0, 0]]), zero)
    expected, speed = 1.0, 0.0
    for _ in range(n):
        before = expected
        expected = (expected + h * speed) / (1 + h * h * k * w)
        speed = (expected - before) / h
    assert x[0] == pytest.approx([expected, 0, 0])
    assert v[0] == pytest.approx([speed, 0, 0])
