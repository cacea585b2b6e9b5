"""The ground: bodies land on it, and friction is Coulomb's."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.deform import Material, XpbdOptions, XpbdSolver
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
