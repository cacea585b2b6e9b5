"""The ground: bodies land on it, and friction is Coulomb's."""

from dataclasses import replace

import numpy as np
import pytest
import solver_frame

from deformrf.core.deform import Material, XpbdOptions, XpbdSolver
from deformrf.core.deform.constraints import LEAVING_SPEED
from deformrf.core.geometry import a15_grid, extract

DT = 1.0 / 60.0
G = 9.81
GRID = a15_grid(0.06)
MIDDLE = GRID.rest_vertices[GRID.tets].mean(axis=1)
AWAY = np.linalg.norm(MIDDLE[:, :2] - 0.5, axis=1)
SLAB = extract(GRID, (AWAY < 0.3) & (MIDDLE[:, 2] > 0.2) & (MIDDLE[:, 2] < 0.4))[0]


def make_solver(device, **options):
    free = np.zeros(SLAB.vertex_count, bool)
    options = XpbdOptions(gravity=(0.0, 0.0, -G), **options)
    return XpbdSolver(SLAB.rest_vertices, SLAB.tets, Material(), free, options, device)


def run(x, seconds):
    for _ in range(round(seconds / DT)):
        x.step(DT)


def positions(x):
    return x.vertices.numpy().astype(np.float64)


def test_a_body_lands_on_the_ground_and_lies_there(device):
    x = make_solver(device, ground=0.0)
    low = x.rest_vertices[:, 2].min()
    assert low > 0.1
    run(x, 5.0)
    now = positions(x)
    np.testing.assert_allclose(now[:, 2], x.rest_vertices[:, 2] - low, atol=0.02)
    np.testing.assert_allclose(now[:, :2], x.rest_vertices[:, :2], atol=0.3)  # it bounces
    assert abs(now[:, 2].min()) < 1e-6
    assert np.linalg.norm(x.velocities.numpy(), axis=1).max() < 0.01


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_body_slides_down_a_slope_beyond_coulombs_angle(device, friction):
    """Gravity turns within a second to 2° less than that angle: it stays; to 2° more: it slides."""
    critical, low = np.degrees(np.arctan(friction)), SLAB.rest_vertices[:, 2].min()
    x = make_solver(device, ground=low, friction=friction)
    bottom = SLAB.rest_vertices[:, 2] < low + 1e-6

    def turn(start, end, seconds):
        """How far the bottom goes meanwhile."""
        before = positions(x)[bottom].mean(axis=0)
        for i in range(round(seconds / DT)):
            angle = np.radians(start + (end - start) * min(1.0, (i + 1) * DT))
            x.set_options(replace(x.options, gravity=(G * np.sin(angle), 0, -G * np.cos(angle))))
            x.step(DT)
        return (positions(x)[bottom].mean(axis=0) - before)[0]

    run(x, 1.0)
    turn(0.0, critical - 2.0, 2.0)
    assert abs(turn(critical - 2.0, critical - 2.0, 1.0)) < 2e-3
    turn(critical - 2.0, critical + 2.0, 1.0)
    angle = np.radians(critical + 2.0)
    pull = G * (np.sin(angle) - friction * np.cos(angle))
    assert turn(critical + 2.0, critical + 2.0, 1.0) > 0.5 * pull


def test_friction_stops_a_sliding_body_where_coulomb_says(device):
    """v²/(2 μ g) on, and without friction it doesn't stop."""
    speed, low = 1.0, SLAB.rest_vertices[:, 2].min()
    for friction in (0.0, 0.3):
        x = make_solver(device, ground=low, friction=friction)
        run(x, 1.0)
        settled = positions(x)
        x.set_state(settled, np.full(settled.shape, [speed, 0, 0]))
        run(x, 1.0)
        way = (positions(x) - settled).mean(axis=0)
        expected = speed**2 / (2 * friction * G) if friction else speed
        assert way[0] == pytest.approx(expected, rel=0.1)


def test_a_body_that_was_held_below_the_ground_leaves_it_slowly(device):
    """It isn't thrown into the air by where it is let go."""
    depth, low = 0.04, SLAB.rest_vertices[:, 2].min()
    for gravity in (0.0, G):
        x = make_solver(device, ground=low + depth)
        x.set_options(replace(x.options, gravity=(0.0, 0.0, -gravity)))
        bottom = SLAB.rest_vertices[:, 2] < low + 0.5 * depth
        x.set_pinned(bottom)
        run(x, 0.5)
        x.set_pinned(np.zeros(SLAB.vertex_count, bool))
        lows, rises = [], []
        for _ in range(round(2.0 / DT)):
            x.step(DT)
            now = positions(x)
            lows.append(now[:, 2].min() - low)
            rises.append((now[:, 2] - SLAB.rest_vertices[:, 2]).mean())
        assert np.diff(lows).max() < 3.0 * LEAVING_SPEED * DT  # it also springs back into shape
        assert np.linalg.norm(x.velocities.numpy(), axis=1).max() < 3.0 * LEAVING_SPEED
        if gravity:
            assert max(rises) < 1.3 * depth and lows[-1] > 0.98 * depth


def test_vertices_below_the_ground_move_as_the_reference_says(device):
    rng = np.random.default_rng()
    material, friction = Material(young_modulus=1e5, damping=0.0), float(rng.uniform(0.0, 1.0))
    options = XpbdOptions(substep_count=6, ground=0.3, friction=friction, rescue=False)
    free = np.zeros(SLAB.vertex_count, bool)
    x = XpbdSolver(SLAB.rest_vertices, SLAB.tets, material, free, options, device)
    start = SLAB.rest_vertices + 0.002 * rng.normal(size=SLAB.rest_vertices.shape)
    start = start.astype(np.float32).astype(float)
    velocities = (0.3 * rng.normal(size=start.shape)).astype(np.float32).astype(float)
    assert (start[:, 2] < 0.25).any() and (start[:, 2] > 0.3).any()
    settings = solver_frame.settings_of(x, DT)
    frame = solver_frame.Frame(**settings, anchors=start, targets=start)
    expected, expected_velocities = solver_frame.step(frame, start, velocities)
    x.set_state(start, velocities)
    x.step(DT)
    np.testing.assert_allclose(positions(x), expected, atol=3e-6)
    np.testing.assert_allclose(x.velocities.numpy(), expected_velocities, atol=3e-3)
    deep = start[:, 2] < 0.25
    risen = (positions(x) - start)[deep, 2]
    assert risen.max() < 1.01 * LEAVING_SPEED * DT + 0.02 and (risen > 0.0).any()
