"""What lies free comes to rest: dropped bodies and stacks sleep, balls roll to a stop.

What flies, bounces or is held moves as with the first integrator, which resists nothing.
"""

import math

import numpy as np
import pytest
from contact_scenes import box, joined

from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.core.deform import Material, XpbdOptions, XpbdSolver
from deformrf.core.deform.rigid_motion import ROLLING, SHAKING
from deformrf.core.field import load
from deformrf.core.geometry import a15_grid, extract

DT = 1.0 / 60.0
G = 9.81
INTEGRATORS = "euler", "extrapolated"
RADIUS = 0.15  # of a ball; its radius of gyration is √0.6 of that, and its I 2/5 m R²
RESISTED = (ROLLING * math.sqrt(0.6) + SHAKING) * G / 1.4  # m/s², of a ball that rolls


def make_solver(rest, tets, material=None, pinned=None, **options):
    options = XpbdOptions(**{"gravity": (0.0, 0.0, -G), "ground": 0.0} | options)
    pinned = np.zeros(len(rest), bool) if pinned is None else pinned
    return XpbdSolver(rest, tets, material or Material(), pinned, options)


def falls_asleep(solver, seconds):
    """When the solver sleeps [s]; infinite if not within so many seconds."""
    for frame in range(round(seconds / DT)):
        solver.step(DT)
        if solver.settled:
            return frame * DT
    return np.inf


def run(solver, seconds):
    """Heights of the middle in each frame."""
    heights = []
    for _ in range(round(seconds / DT)):
        solver.step(DT)
        heights.append(solver.vertices.numpy()[:, 2].mean())
    return np.array(heights)


def ball():
    """Its surface is made round: a polyhedron would lie on a face."""
    mesh = a15_grid(0.1)
    middles = mesh.rest_vertices[mesh.tets].mean(axis=1)
    inside, _ = extract(mesh, np.linalg.norm(middles - 0.5, axis=1) < 0.45)
    x = inside.rest_vertices - 0.5
    surface = np.linalg.norm(x, axis=1) > 0.4
    x[surface] *= (0.45 / np.linalg.norm(x[surface], axis=1))[:, None]
    x *= RADIUS / 0.45
    return x - [0.0, 0.0, x[:, 2].min()], inside.tets


def rolling(rest, speed):
    """Velocities of a ball that rolls along x without sliding, v = ω R.  [V, 3]"""
    spin = [0.0, speed / RADIUS, 0.0]
    return np.array([speed, 0.0, 0.0]) + np.cross(spin, rest - [0.0, 0.0, RADIUS])


def spin_of(solver):
    """The spin of the whole mesh [rad/s], all vertices of equal weight.  [3]"""
    x, v = (a.numpy().astype(float) for a in (solver.vertices, solver.velocities))
    x, v = x - x.mean(axis=0), v - v.mean(axis=0)
    inertia = (x**2).sum() * np.eye(3) - x.T @ x
    return np.linalg.solve(inertia, np.cross(x, v).sum(axis=0))


def test_the_bundled_helmet_rests_where_it_was_dropped():
    mesh = load(DEFAULT_MODEL).mesh
    ground = float(mesh.rest_vertices[:, 2].min()) - 0.05
    assert falls_asleep(make_solver(mesh.rest_vertices, mesh.tets, ground=ground), 5.0) < 5.0


@pytest.mark.parametrize("modulus", [1e6, 1e8])
@pytest.mark.parametrize("substeps", [24, 96])
@pytest.mark.parametrize("aside", [(0.0, 0.0), (0.013, 0.009)])
def test_a_stack_of_three_cubes_sleeps(modulus, substeps, aside):
    """One exactly above the other, and with edges that lie on faces."""
    vertices, tets = box((4, 4, 4), 0.05)
    steps = [(*np.multiply(aside, k % 2), 0.001 + 0.201 * k) for k in range(3)]
    rest, tets, slices = joined(*((vertices + step, tets) for step in steps))
    solver = make_solver(rest, tets, Material(young_modulus=modulus), substep_count=substeps)
    assert falls_asleep(solver, 4.0) < 4.0
    moved = solver.vertices.numpy() - rest
    assert all(np.linalg.norm(moved[part].mean(axis=0)) < 0.02 for part in slices)


def test_a_ball_rolls_and_stops():
    """It slows down by the load's torque, and by its facets."""
    speed = 0.6
    rest, tets = ball()
    solver = make_solver(rest, tets)
    solver.set_state(rest, rolling(rest, speed))
    assert falls_asleep(solver, 9.0) < 9.0
    way = (solver.vertices.numpy() - rest).mean(axis=0)[0]
    # A sliding body of these numbers goes 0.04 m.
    assert 0.08 < way < 1.05 * speed**2 / (2.0 * RESISTED)


def test_a_ball_rolls_down_a_slope_faster_and_faster():
    """On 5°: the load's torque and its resistance to sliding take no more than their share."""
    rest, tets = ball()
    slope, speed, seconds, ways = math.radians(5.0), 0.6, 2.0, []
    gravity = G * math.sin(slope), 0.0, -G * math.cos(slope)
    for integrator in INTEGRATORS:
        solver = make_solver(rest, tets, gravity=gravity, integrator=integrator)
        solver.set_state(rest, rolling(rest, speed))
        run(solver, seconds)
        ways.append((solver.vertices.numpy() - rest).mean(axis=0)[0])
    assert solver.velocities.numpy().mean(axis=0)[0] > 1.5 * speed
    assert ways[1] > ways[0] - 1.5 * 0.5 * RESISTED * seconds**2


def test_what_flies_keeps_its_spin():
    """Above a ground, as with the first integrator, to the last digits."""
    rest, tets = box((3, 2, 2), 0.1)
    spins = []
    for integrator in INTEGRATORS:
        solver = make_solver(rest, tets, ground=-50.0, air_drag=0.3, integrator=integrator)
        turning = np.cross([0.5, 1.0, 3.0], rest - rest.mean(axis=0))
        solver.set_state(rest, np.array([1.0, 0.0, 4.0]) + turning)
        run(solver, 1.0)
        spins.append(spin_of(solver))
    np.testing.assert_allclose(spins[1], spins[0], atol=1e-4)
    assert np.linalg.norm(spins[1]) > 2.0


def test_a_bounce_keeps_its_height():
    """A support takes no more than a fiftieth of the weight, and for as long as it touches."""
    rest, tets = ball()
    heights = []
    for integrator in INTEGRATORS:
        solver = make_solver(rest, tets, ground=-0.3, integrator=integrator)
        path = run(solver, 1.2)
        first = int(np.argmin(path[:30]))
        heights.append(path[first:].max() - path.min())
    assert heights[1] == pytest.approx(heights[0], rel=0.02)
    assert heights[1] > 0.05


def test_what_is_held_is_not_braked():
    """It swings, by the bits, as with the first integrator."""
    rest, tets = box((1, 1, 6), 0.1)
    swings = []
    for integrator in INTEGRATORS:
        held = rest[:, 2] > 0.55
        solver = make_solver(rest, tets, pinned=held, ground=-1.0, integrator=integrator)
        solver.set_state(rest, np.array([1.0, 0.0, 0.0]) * (0.6 - rest[:, 2:]))
        run(solver, 0.5)
        swings.append(solver.velocities.numpy())
    assert np.array_equal(*swings)
    assert np.abs(swings[0]).max() > 0.1


def test_the_first_integrator_rocks_on():
    """What a session without an integrator plays: nothing brings a rocking body to rest."""
    rest, tets = box((4, 4, 4), 0.05)
    turn = np.array([[0.98, 0.0, 0.2], [0.0, 1.0, 0.0], [-0.2, 0.0, 0.98]])
    tilted = rest @ turn.T
    tilted[:, 2] -= tilted[:, 2].min()
    times = []
    for integrator in INTEGRATORS:
        solver = make_solver(rest, tets, integrator=integrator)
        solver.set_state(tilted)
        times.append(falls_asleep(solver, 3.0))
    assert times[1] < times[0]
