"""Recovery of bodies that are stuck: held by nothing, sound, and yet not in their rest shape."""

import numpy as np
import pytest
import warp as wp
from random_use import Session, bodies

from deformrf.core.deform import Material, Sphere, XpbdOptions, XpbdSolver
from deformrf.core.deform.recovery import (
    STUCK_INTERVAL,
    STUCK_SHRINKS,
    STUCK_SPEED,
    SWINGS,
)
from deformrf.core.geometry import a15_grid
from deformrf.wings.lab.stability.measure import NamedMaterial, run_case
from deformrf.wings.lab.stability.stress import CASES

DT = 1.0 / 60.0
MESH = a15_grid(0.25)
REST = MESH.rest_vertices
BENT = REST * [1.0, 1.0, 1.1]  # sound, but 10 % longer
NOBODY = np.zeros(MESH.vertex_count, bool)


def make_solver(material=None, pinned=NOBODY, **options):
    return XpbdSolver(REST, MESH.tets, material or Material(), pinned, XpbdOptions(**options))


def hold_still(solver, shape, seconds, speed=0.0, shrinks=0.0):
    """Let time pass in which the body stays in a shape, as in a minimum of its energy.

    Args:
        speed: Of every vertex when the solver looks [m/s].
        shrinks: The rate at which the body returns to its rest shape [1/s].

    Returns:
        The seconds after which a rescue ran, or None.
    """
    solver.set_state(shape)
    for frame in range(round(seconds / DT)):
        solver.step(DT)
        if solver.rescue.running:
            return frame * DT
        now = REST + np.exp(-shrinks * frame * DT) * (shape - REST)
        solver.vertices.assign(now.astype(np.float32))
        solver.velocities.fill_(wp.vec3(speed, 0.0, 0.0))
    return None


@pytest.mark.parametrize("damping", [1.0, 3.0, 10.0])
def test_a_part_that_does_not_return_is_rescued(damping):
    after = hold_still(make_solver(Material(damping=damping)), BENT, 20.0)
    interval = max(STUCK_INTERVAL, SWINGS / damping)
    assert 2 * interval <= after <= 2 * interval + 3.0


@pytest.mark.parametrize("shrinks, rescued", [(2.0, False), (0.5, True)])
def test_a_part_that_returns_is_left_alone(shrinks, rescued):
    after = hold_still(make_solver(), BENT, 10.0, shrinks=shrinks * STUCK_SHRINKS)
    assert (after is not None) == rescued


@pytest.mark.parametrize(
    "found, drag, speed, rescued",
    [
        (False, 1.0, 0.0, True),
        (True, 1.0, 0.5, False),
        (True, 1.0, 2.0, True),
        (False, 0.0, 2.0, False),
        (False, 0.0, 0.5, True),
    ],
    ids=["alone", "lies against something", "turns for ever", "may fly", "is slow"],
)
def test_what_contacts_or_its_flight_hold_is_not_stuck(monkeypatch, found, drag, speed, rescued):
    """Contacts hold what is slow; what is fast in no air flies, and its spin stretches it."""
    solver = make_solver(air_drag=drag)
    monkeypatch.setattr(solver._contact, "found", lambda: found)
    after = hold_still(solver, BENT, 10.0, speed=speed * STUCK_SPEED * solver.object_size)
    assert (after is not None) == rescued


@pytest.mark.parametrize(
    "integrator, after", [("extrapolated", 2 * STUCK_INTERVAL), ("euler", None)]
)
def test_what_would_not_move_without_its_contacts_either_is_stuck(monkeypatch, integrator, after):
    """As a loop that turned over and lies against itself.  Euler's sessions are as they were."""
    solver = make_solver(air_drag=1.0, integrator=integrator)
    monkeypatch.setattr(solver._contact, "found", lambda: True)
    monkeypatch.setattr(solver._recovery, "_alone", lambda: None)
    rescued = hold_still(solver, BENT, 10.0)
    assert (rescued is None) == (after is None) and (after is None or after <= rescued <= after + 3)


def test_a_trial_without_contacts_is_taken_back(monkeypatch, device):
    solver = XpbdSolver(REST, MESH.tets, Material(), NOBODY, XpbdOptions(air_drag=1.0), device)
    solver.set_state(BENT)
    for _ in range(10):
        solver.step(DT)
    arrays = solver.vertices, solver.velocities, solver._state.deltas, solver._state.anchors
    before = [array.numpy().copy() for array in arrays]
    away = solver._recovery._distances()
    monkeypatch.setattr(solver._contact, "found", lambda: True)
    assert solver._recovery._kept_by_contact(away).all()  # it went on to its rest shape
    for array, values in zip(arrays, before, strict=True):
        np.testing.assert_array_equal(array.numpy(), values)


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("seed", [1, 2])
def test_columns_that_were_folded_for_ever_come_back(seed, rigid):
    """They were a quarter to a half of their size away, and their boxes overlapped."""
    columns, case = list(bodies())[2], next(c for c in CASES if c.name == "broken tets")
    result = run_case(columns, NamedMaterial("columns", Material(), rigid), case, "cpu", seed)
    assert result.passed, result


@pytest.mark.parametrize(
    "material, pinned, options",
    [
        (Material(), NOBODY, {"gravity": (0.0, 0.0, -1.0)}),
        (Material(), NOBODY, {"wind": (1.0, 0.0, 0.0), "air_drag": 1.0}),
        (Material(), NOBODY, {"colliders": (Sphere((0.0, 0.0, 3.0), 0.1),)}),
        (Material(), NOBODY, {"ground": -5.0}),
        (Material(), REST[:, 2] > -1.0, {}),  # all of it is pinned, as it is bent
        (Material(damping=0.0), NOBODY, {}),
        (Material(yield_strain=0.5), NOBODY, {}),
    ],
    ids=["weight", "wind", "collider", "ground", "pins", "undamped", "yields"],
)
def test_what_something_holds_is_not_stuck(material, pinned, options):
    assert hold_still(make_solver(material, pinned, **options), BENT, 16.0) is None


def test_at_rest_nothing_is_stuck():
    assert hold_still(make_solver(), REST, 16.0) is None


@pytest.mark.parametrize("found", [False, True])
def test_a_still_body_in_another_shape_stays_awake(monkeypatch, found):
    """Else it would sleep there for ever; but what contacts keep there may sleep."""
    solver = make_solver()
    monkeypatch.setattr(solver._contact, "found", lambda: found)
    solver.set_state(BENT)
    for _ in range(120):
        solver.step(DT)
        if solver.settled:
            break
        solver.vertices.assign(BENT.astype(np.float32))
        solver._motion.zero_()
        solver.velocities.zero_()
    assert solver.settled == found
    solver.set_state(REST)
    for _ in range(120):
        solver.step(DT)
    assert solver.settled


@pytest.mark.parametrize("number", range(3), ids=["ball", "neck", "two parts"])
def test_random_use_ends_at_rest(number, device):
    """No number is lost meanwhile; `make random-use` does so for a million frames."""
    seed = int(np.random.default_rng().integers(2**32))
    assert Session(list(bodies())[number], seed, device).run() is None, f"seed {seed}"


@pytest.mark.parametrize("number", [155, 677])
def test_a_body_that_random_use_folded_over_its_hinge_returns(number):
    """It was stuck 64 % of its size away, on the machine that found it."""
    mesh = list(bodies())[number % 3]
    assert Session(mesh, [1262718852, number], "cpu").run() is None
