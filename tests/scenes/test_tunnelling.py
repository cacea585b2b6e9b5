"""What is thrown at a sheet as fast as vertices may be doesn't go through it."""

import numpy as np
import pytest
from contact_scenes import box, joined

from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver

EDGE = 0.08  # m, of the cells: the sheet has one, across a meter
ACROSS = 12


def height_of_a_cube_thrown_at_a_sheet(speed, device):
    """The cube's mean height [m] over the sheet, which is held at its border, 0.4 s later."""
    random = np.random.default_rng()
    sheet, of_sheet = box((ACROSS, ACROSS, 1), EDGE)
    sheet = sheet - EDGE * np.array([ACROSS, ACROSS, 1]) / 2.0
    cube, of_cube = box((2, 2, 2), EDGE)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn[0] *= np.linalg.det(turn)
    above = 2.5 * EDGE + random.uniform(0.0, speed * TIME_STEP)
    start = np.append(random.uniform(-0.2, 0.2, 2), above)
    thrown = (cube - EDGE) @ turn.T + start, of_cube
    x, tets, (in_sheet, in_cube) = joined((sheet, of_sheet), thrown)
    held = np.zeros(len(x), bool)
    held[in_sheet] = (np.abs(sheet[:, :2]) > EDGE * (ACROSS - 0.5) / 2.0).any(axis=1)
    options = XpbdOptions(speed_limit=speed / np.ptp(x, axis=0).max(), sleep_motion=0.0)
    solver = XpbdSolver(x, tets, Material(), held, options, device)
    velocities = np.zeros_like(x)
    velocities[in_cube, 2] = -speed
    solver.set_state(x, velocities)
    for _ in range(24):
        solver.step(TIME_STEP)
    return solver.vertices.numpy()[in_cube, 2].mean()


@pytest.mark.parametrize("times", [0.2, 1.0, 2.0])  # 2: two bodies that meet at the limit
def test_up_to_the_speed_limit_nothing_goes_through_a_sheet(times, device):
    assert height_of_a_cube_thrown_at_a_sheet(times * XpbdOptions.speed_limit, device) > 0.0


def test_without_the_limit_it_would(device):
    assert height_of_a_cube_thrown_at_a_sheet(8.0 * XpbdOptions.speed_limit, device) < 0.0
