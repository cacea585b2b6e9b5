"""Spheres and boxes: the reference against geometry, kernels against the reference, bodies."""

from dataclasses import replace

import numpy as np
import pytest
import solver_frame

from deformrf.core.deform import Box, Material, Sphere, XpbdOptions, XpbdSolver, colliders
from deformrf.core.geometry import a15_grid, extract

DT = 1.0 / 60.0
G = 9.81
GRID = a15_grid(0.1)
MIDDLE = GRID.rest_vertices[GRID.tets].mean(axis=1)
BALL = extract(GRID, np.linalg.norm(MIDDLE - 0.5, axis=1) < 0.3)[0]
REST = BALL.rest_vertices.astype(np.float32).astype(np.float64)
BOX = Box((0.1, -0.2, 0.0), (0.6, 0.8, 1.0))
SPHERE = Sphere((0.1, -0.2, 0.0), 0.5)


def make_solver(device, *things, material=None, **options):
    options = XpbdOptions(colliders=things, rescue=False, **options)
    free = np.zeros(len(REST), bool)
    return XpbdSolver(REST, BALL.tets, material or Material(), free, options, device)


def positions(solver):
    return solver.vertices.numpy().astype(np.float64)


def run(solver, seconds):
    for _ in range(round(seconds / DT)):
        solver.step(DT)


@pytest.mark.parametrize("thing", [BOX, SPHERE])
def test_the_way_out_ends_on_the_surface_and_is_the_shortest(thing):
    points = np.random.default_rng().uniform(-1, 1, (500, 3))
    units, push = solver_frame.way_out(thing.row, np.array(thing.center), points)
    np.testing.assert_allclose(np.linalg.norm(units, axis=1), 1.0)
    arms = points - thing.center
    if thing is SPHERE:
        inside = np.linalg.norm(arms, axis=1) < thing.radius
        left = thing.radius - np.linalg.norm(arms, axis=1)
    else:
        inside = (np.abs(arms) < 0.5 * np.array(thing.sides)).all(axis=1)
        left = (0.5 * np.array(thing.sides) - np.abs(arms)).min(axis=1)
    assert 0 < inside.sum() < len(points)
    np.testing.assert_array_equal(push > 0, inside)
    np.testing.assert_allclose(push[inside], left[inside])
    moved = (points + push[:, None] * units)[inside]
    assert (solver_frame.way_out(thing.row, np.array(thing.center), moved)[1] < 1e-12).all()


@pytest.mark.parametrize("trial", range(4))
def test_a_frame_agrees_with_the_reference(device, trial):
    """A random sphere and box that move through the ball, with random friction."""
    random = np.random.default_rng()
    things = (
        Sphere(tuple(random.uniform(0.4, 0.6, 3)), random.uniform(0.15, 0.3)),
        Box(tuple(random.uniform(0.3, 0.7, 3)), tuple(random.uniform(0.2, 0.5, 3))),
    )
    solver = make_solver(device, *things, friction=random.uniform(0, 2), substep_count=5)
    start = REST + random.uniform(-0.01, 0.01, REST.shape)
    start = start.astype(np.float32).astype(np.float64)
    solver.set_state(start)
    ends = np.array([thing.center for thing in things]) + random.uniform(-0.05, 0.05, (2, 3))
    solver.move_colliders(ends)
    solver.step(DT)
    rows = np.array([thing.row for thing in things], np.float32).astype(np.float64)
    rows[:, 4:7] = ends.astype(np.float32)
    frame = solver_frame.Frame(
        **solver_frame.settings_of(solver, DT),
        anchors=start,
        targets=start,
        colliders=rows,
        free_parts=np.zeros(len(start), int),
    )
    x, v = solver_frame.step(frame, start, np.zeros_like(start))
    without = solver_frame.step(replace(frame, colliders=()), start, np.zeros_like(start))[0]
    assert np.abs(x - without).max() > 0.01
    np.testing.assert_allclose(positions(solver), x, atol=3e-6)
    np.testing.assert_allclose(solver.velocities.numpy(), v, atol=5e-6 / DT)


def test_a_ball_falls_onto_a_box_and_may_roll_there(device):
    box = Box((0.5, 0.5, -0.3), (2.0, 2.0, 0.6))  # its top is at 0
    solver = make_solver(device, box, gravity=(0.0, 0.0, -G))
    run(solver, 6.0)
    assert abs(positions(solver)[:, 2].min()) < 1e-6
    assert abs(solver.velocities.numpy()[:, 2].mean()) < 0.01


def test_a_sphere_pushes_a_body_away_and_is_never_entered(device):
    sphere = Sphere((-0.2, 0.5, 0.5), 0.25)
    solver = make_solver(device, sphere, friction=0.0)
    for frame in range(60):
        center = np.array([[-0.2 + 0.8 * (frame + 1) / 60, 0.5, 0.5]])
        solver.move_colliders(center)
        solver.step(DT)
        away = np.linalg.norm(positions(solver) - center, axis=1)
        assert away.min() > 0.25 - 1e-5
    assert positions(solver)[:, 0].mean() - REST[:, 0].mean() > 0.1
    assert solver.velocities.numpy()[:, 0].mean() > 0.1


def test_friction_carries_a_body_along_on_a_box_that_moves(device):
    """A table that moves at 0.2 m/s, with friction and without."""
    table, top = np.array([0.5, 0.5, -0.1]), REST[:, 2].min()
    ways = {}
    for friction in (0.0, 1.0):
        solver = make_solver(
            device,
            Box((*table[:2], top - 0.5), (4.0, 4.0, 1.0)),
            gravity=(0, 0, -G),
            friction=friction,
        )
        run(solver, 1.0)
        before = positions(solver).mean(axis=0)
        for frame in range(60):
            way = 0.2 * (frame + 1) / 60
            solver.move_colliders([[table[0] + way, table[1], top - 0.5]])
            solver.step(DT)
        ways[friction] = (positions(solver).mean(axis=0) - before)[0]
    assert abs(ways[0.0]) < 0.02
    assert ways[1.0] == pytest.approx(0.2, abs=0.03)


def test_a_collider_stands_still_after_its_move(device):
    """Else it would push on in the next frame."""
    solver = make_solver(device, Sphere((-0.2, 0.5, 0.5), 0.25))
    solver.move_colliders([[0.0, 0.5, 0.5]])
    solver.step(DT)
    solver.step(DT)
    row = solver._frame._frame.colliders.numpy()[0]
    np.testing.assert_allclose(row[1:4], [0.0, 0.5, 0.5], atol=1e-7)
    np.testing.assert_array_equal(row[1:4], row[4:7])


@pytest.mark.parametrize(
    "make",
    [
        lambda: Sphere((0, 0, 0), 0.0),
        lambda: Sphere((0, 0, np.nan), 1.0),
        lambda: Sphere((0, 0), 1.0),
        lambda: Box((0, 0, 0), (1, 1, 0)),
        lambda: Box((0, 0, 0), (1, 1)),
        lambda: XpbdOptions(colliders=(SPHERE,) * (colliders.MOST_COLLIDERS + 1)),
    ],
)
def test_what_can_be_no_collider_is_refused(make):
    with pytest.raises(ValueError):
        make()


def test_colliders_that_moved_stay_there_when_other_options_change(device):
    solver = make_solver(device, Sphere((-0.2, 0.5, 0.5), 0.25))
    solver.move_colliders([[0.0, 0.5, 0.5]])
    solver.step(DT)
    solver.set_options(replace(solver.options, friction=0.1))
    solver.step(DT)
    row = solver._frame._frame.colliders.numpy()[0]
    np.testing.assert_allclose(row[1:4], [0.0, 0.5, 0.5], atol=1e-7)
