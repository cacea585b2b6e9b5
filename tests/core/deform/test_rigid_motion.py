"""Damping spares rigid motion: closed forms, momenta, and the kernel against the reference."""

import numpy as np
import pytest
import warp as wp
from resting import Kept, RigidMotion, rested
from solver_frame import rigid_velocities

from deformrf.core.deform import Material, XpbdOptions, XpbdSolver, constraints, rigid_motion
from deformrf.core.deform.rigid_motion import Flight
from deformrf.core.geometry import a15_grid, extract

DT = 1.0 / 60.0
GRID = a15_grid(0.1)
WHOLE = extract(GRID, np.linalg.norm(GRID.rest_vertices[GRID.tets].mean(1) - 0.5, axis=1) < 0.4)[0]


def two_parts():
    """Two boxes beside each other, as one mesh: vertices [V, 3] and tets [T, 4]."""
    rest = WHOLE.rest_vertices
    vertices = np.concatenate([rest, 0.5 * rest + np.array([1.5, 0.0, 0.0])])
    return vertices, np.concatenate([WHOLE.tets, WHOLE.tets + len(rest)])


def make_solver(device, pinned=None, damping=3.0, mesh=None, **options):
    vertices, tets = mesh or (WHOLE.rest_vertices, WHOLE.tets)
    pinned = np.zeros(len(vertices), bool) if pinned is None else pinned
    options = XpbdOptions(rescue=False, **options)
    return XpbdSolver(vertices, tets, Material(damping=damping), pinned, options, device)


def masses_of(solver):
    return constraints.lumped_masses(solver.rest_vertices, solver.tets, 1000.0)


def momenta(solver):
    """Momentum and angular momentum.  2 × [3]"""
    x, v = (a.numpy().astype(np.float64) for a in (solver.vertices, solver.velocities))
    m = masses_of(solver)[:, None]
    return (m * v).sum(axis=0), (m * np.cross(x, v)).sum(axis=0)


def test_a_rigid_motion_is_its_own():
    random = np.random.default_rng()
    x, m = random.normal(size=(20, 3)), random.uniform(0.1, 5.0, 20)
    v = random.normal(size=3) + np.cross(random.normal(size=3), x)
    np.testing.assert_allclose(rigid_velocities(x, v, m), v, atol=1e-4)


def test_a_rigid_motion_has_the_momenta_of_the_whole():
    random = np.random.default_rng()
    x, v = random.normal(size=(2, 20, 3))
    m = random.uniform(0.1, 5.0, 20)
    left = m[:, None] * (v - rigid_velocities(x, v, m))
    np.testing.assert_allclose(left.sum(axis=0), 0.0, atol=1e-12)
    moment = np.cross(x, m[:, None] * v).sum(axis=0)
    scale = 1e-4 * np.abs(moment).max()
    np.testing.assert_allclose(np.cross(x, left).sum(axis=0), 0.0, atol=max(scale, 1e-4))


@pytest.mark.parametrize("shape", ["solid", "line", "point"])
def test_the_kernel_agrees_with_the_reference(device, shape):
    """Two parts, each with a motion of its own."""
    random = np.random.default_rng()
    solver = make_solver(device, mesh=two_parts())
    part_of = solver._part_of
    x = solver.rest_vertices + random.normal(scale=0.05, size=(len(part_of), 3))
    x *= {"solid": (1.0, 1.0, 1.0), "line": (1.0, 0.0, 0.0), "point": (0.0, 0.0, 0.0)}[shape]
    v = random.normal(size=x.shape) + np.where(part_of == 0, 2.0, -1.0)[:, None]
    solver.set_state(x, v)
    decay = random.uniform(0.1, 0.9)
    solver._holds._update()
    solver._free_parts.select(np.ones(2, bool), decay)
    assert solver._free_parts.damp()
    x, v = (a.astype(np.float32).astype(np.float64) for a in (x, v))
    masses = masses_of(solver)
    for part in range(2):
        some = part_of == part
        rigid = rigid_velocities(x[some], v[some], masses[some])
        expected = rigid + decay * (v[some] - rigid)
        np.testing.assert_allclose(solver.velocities.numpy()[some], expected, atol=2e-5)


@pytest.mark.parametrize("lift", [-0.5, 0.0005, 0.01, 0.3, 2.0])
def test_rest_agrees_with_the_reference(device, lift):
    """Four frames of two parts, which their supports lift by this share of their weight."""
    random = np.random.default_rng()
    solver = make_solver(device, mesh=two_parts())
    x = solver.rest_vertices + random.normal(scale=0.05, size=solver.rest_vertices.shape)
    v = 0.02 * random.normal(size=x.shape)
    solver.set_state(x, v)
    solver._holds._update()
    up = random.normal(size=3)
    up /= np.linalg.norm(up)
    flight = Flight(random.uniform(0.9, 1.0), random.normal(scale=0.1, size=3), up, 0.16)
    decay, parts = random.uniform(0.1, 0.9), [solver._part_of == part for part in range(2)]
    solver._free_parts.select(np.ones(2, bool), decay, flight)
    x, masses = x.astype(np.float32).astype(np.float64), masses_of(solver)
    kept = [None, None]
    for _ in range(4):
        v = v.astype(np.float32).astype(np.float64)
        solver.velocities.assign(v)
        solver._free_parts.damp()
        expected, after = v.copy(), v.copy()
        for part, some in enumerate(parts):
            motion = RigidMotion.of(x[some], v[some], masses[some])
            new = Kept(motion.velocity, motion.spin, np.zeros(3))
            if kept[part] is not None:
                new = rested(motion, kept[part], flight)
            moves = RigidMotion(motion.mass, motion.middle, *new[:2], motion.inertia)
            expected[some] = moves.at(x[some]) + decay * (v[some] - motion.at(x[some]))
            kept[part] = new
            flown = flight.factor * new.velocity + flight.gain + lift * flight.weight * up
            turn = 0.01 * random.normal(size=3)
            after[some] = flown + np.cross(turn, x[some] - motion.middle)
        np.testing.assert_allclose(solver.velocities.numpy(), expected, atol=2e-6)
        v = after + 1e-3 * random.normal(size=v.shape)


def test_a_part_that_is_not_finite_is_left_alone(device):
    solver = make_solver(device, mesh=two_parts())
    v = np.random.default_rng().normal(size=solver.rest_vertices.shape)
    solver.set_state(solver.rest_vertices, v)
    lost = solver.vertices.numpy()
    lost[0] = np.nan
    solver.vertices.assign(lost)
    solver._free_parts.select(np.ones(2, bool), 0.5)
    solver._free_parts.damp()
    left_alone = (solver.velocities.numpy() == v.astype(np.float32)).all(axis=1)
    np.testing.assert_array_equal(left_alone, solver._part_of == solver._part_of[0])


def test_a_second_of_free_fall_goes_half_g(device):
    solver = make_solver(device, gravity=(0.0, 0.0, -9.81))
    for _ in range(60):
        solver.step(DT)
    fallen = solver.rest_vertices[:, 2] - solver.vertices.numpy()[:, 2]
    np.testing.assert_allclose(fallen, 0.5 * 9.81, rtol=0.01)


def test_a_damped_body_keeps_its_momenta(device):
    """Thrown, turning and shaking: after a second it still flies and turns, and hardly shakes."""
    solver = make_solver(device, damping=5.0)
    x = solver.rest_vertices
    shaking = np.random.default_rng().normal(scale=0.5, size=x.shape)
    v = np.array([0.5, 0.0, 0.2]) + np.cross([0.0, 2.0, 3.0], x) + shaking
    solver.set_state(x, v)
    linear, angular = momenta(solver)
    for _ in range(60):
        solver.step(DT)
    after = momenta(solver)
    np.testing.assert_allclose(after[0], linear, atol=1e-3 * np.linalg.norm(linear))
    np.testing.assert_allclose(after[1], angular, atol=0.02 * np.linalg.norm(angular))
    x, v = (a.numpy().astype(np.float64) for a in (solver.vertices, solver.velocities))
    left = v - rigid_velocities(x, v, masses_of(solver))
    assert np.sqrt((left**2).mean()) < 0.07 * np.sqrt((shaking**2).mean())


def test_what_is_held_is_damped_as_a_whole(device):
    """A part with a pin, or on springs, comes to rest; the other part flies on."""
    vertices, tets = two_parts()
    pinned = np.zeros(len(vertices), bool)
    pinned[np.argmin(vertices[: len(vertices) // 2, 2])] = True
    solver = make_solver(device, pinned, mesh=(vertices, tets))
    velocities = np.tile([0.3, 0.0, 0.0], (len(vertices), 1))
    solver.set_state(vertices, velocities)
    for _ in range(120):
        solver.step(DT)
    speeds = np.linalg.norm(solver.velocities.numpy(), axis=1)
    held = solver._part_of == solver._part_of[pinned][0]
    assert speeds[held].max() < 0.1
    np.testing.assert_allclose(speeds[~held], 0.3, rtol=1e-3)


def test_air_stops_what_flies_and_wind_carries_it(device):
    """v relative to the wind falls as exp(-c t)."""
    solver = make_solver(device, air_drag=2.0, wind=(0.0, 1.0, 0.0))
    solver.set_state(solver.rest_vertices, np.tile([1.0, 0.0, 0.0], (WHOLE.vertex_count, 1)))
    for _ in range(30):
        solver.step(DT)
    expected = np.array([0.0, 1.0, 0.0]) + np.exp(-1.0) * np.array([1.0, -1.0, 0.0])
    velocity = solver.velocities.numpy().mean(axis=0)
    np.testing.assert_allclose(velocity, expected, atol=1e-3)


def test_a_body_in_wind_does_not_sleep_after_a_reset(device):
    pinned = WHOLE.rest_vertices[:, 2] < 0.2
    solver = make_solver(device, pinned, wind=(15.0, 0.0, 0.0), air_drag=1.0)
    solver.reset()
    for _ in range(30):
        solver.step(DT)
    assert np.abs(solver.vertices.numpy() - solver.rest_vertices).max() > 1e-3


def test_the_gpu_source_compiles_without_a_gpu(tmp_path):
    module = wp.get_module(rigid_motion.__name__)
    assert wp.compile_aot_module(module, arch=90, module_dir=tmp_path)
