"""Bodies that touch: frames against the reference, and scenes that contact has to hold."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import solver_frame
import warp as wp
from contact_scenes import (
    body_with_arm,
    box,
    joined,
    linked_rings,
    linking_number,
    pressed_balls,
    two_balls,
)

from deformrf.core.definition.contact import Contacts
from deformrf.core.deform import Material, XpbdOptions, XpbdSolver, constraints
from deformrf.core.deform.contact import boxes
from deformrf.core.deform.contact.clusters import barycentric
from deformrf.core.deform.contact.contact import Contact, contact_modules
from deformrf.core.deform.contact.surface import closest_weights
from deformrf.core.geometry import boundary_faces, edges, tet_neighbours

DT = 1.0 / 60.0
EARTH = (0.0, 0.0, -9.81)


def make_solver(rest, tets, pinned=None, device="cpu", material=None, **options):
    pinned = np.zeros(len(rest), bool) if pinned is None else pinned
    material = material or Material()
    return XpbdSolver(rest, tets, material, pinned, XpbdOptions(**options), device)


def run(solver, seconds):
    for _ in range(round(seconds / DT)):
        solver.step(DT)


def positions(solver):
    return solver.vertices.numpy().astype(np.float64)


def contacts_of(arrays) -> Contacts:
    """What was found, for the reference."""
    count = int(arrays.counts.numpy()[0])
    of_all = (arrays.vertices, arrays.shares, arrays.bevels)
    lists = [
        array.numpy()[:count].astype(kind)
        for array, kind in zip(of_all, (int, float, float), strict=True)
    ]
    return Contacts(*lists, *map(float, arrays.limits.numpy()))


@pytest.mark.parametrize("depth", [-0.01, 0.05])
@pytest.mark.parametrize("hold", ["free", "springs", "exact"])
def test_a_frame_with_contacts_agrees_with_the_reference(device, depth, hold):
    random = np.random.default_rng()
    solver, _, state, velocities = pressed_balls(device, depth, DT)
    solver.set_options(
        XpbdOptions(substep_count=8, friction=random.uniform(0, 2), ground=0.15, rescue=False)
    )
    solver.set_state(state, velocities)
    targets, ids = state.copy(), np.flatnonzero(state[:, 2] > state[:, 2].max() - 0.1)
    stiffness = {"free": None, "springs": (500.0, 1e3), "exact": ()}[hold]
    if stiffness is not None:
        solver.grab(ids, *stiffness)
        targets[ids] += [0.01, 0.0, -0.02]
        targets = targets.astype(np.float32).astype(np.float64)
        solver.move(targets[ids])
    solver.step(DT)

    settings, springs = solver_frame.settings_of(solver, DT), None
    if hold == "springs":
        w, reach = settings["inverse_masses"], settings["timing"].reach
        springs = np.full((len(w), 2), (constraints.NO_SPRING, 0.0))
        springs[ids] = constraints.spring_coefficients(*stiffness, w[ids], reach)
    frame = solver_frame.Frame(
        **settings,
        anchors=state,
        targets=targets,
        springs=springs,
        contacts=contacts_of(solver._contact.arrays),
    )
    x, v = solver_frame.step(frame, state, velocities)
    assert len(frame.contacts.shares) > 50
    without = solver_frame.step(replace(frame, contacts=None), state, velocities)[0]
    assert np.abs(x - without).max() > 1e-3
    difference = np.abs(solver.vertices.numpy() - x).max(axis=1)
    # A contact on an edge of its triangle may be active in one of them alone.
    assert np.quantile(difference, 0.95) < 3e-6
    assert difference.max() < 1e-3
    faster = np.abs(solver.velocities.numpy() - v).max(axis=1)
    assert np.quantile(faster, 0.95) < 3e-3 < np.abs(v).max()


def test_results_are_bitwise_equal_for_any_number_of_threads():
    results = []
    solver, _, state, velocities = pressed_balls("cpu", 0.03, DT)
    for thread_count in (1, 2, 3):
        solver._frame._pace.thread_count = thread_count
        solver._frame._pace.note = lambda seconds: None
        solver.set_state(state, velocities)
        run(solver, 0.05)
        assert solver._contact.arrays.counts.numpy()[0] > 0
        results.append(solver.vertices.numpy().copy())
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_what_does_not_touch_moves_as_without_contact(device):
    rest, tets, _ = two_balls(0.095, 1.0)
    state = rest + np.random.default_rng().normal(scale=0.001, size=rest.shape)
    results = []
    for contact in (False, True):
        solver = make_solver(rest, tets, device=device, contact=contact)
        solver.set_state(state)
        run(solver, 0.2)
        results.append(solver.vertices.numpy().copy())
    np.testing.assert_array_equal(*results)


def test_a_body_that_is_hit_wakes_up(device):
    rest, tets, (lower, upper) = two_balls(0.095, 0.7)
    solver = make_solver(rest, tets, device=device)
    top = np.flatnonzero(rest[:, 2] > rest[:, 2].max() - 0.1)
    solver.grab(top)
    for frame in range(40):
        solver.move(rest[top] - [0.0, 0.0, 0.25 * min(1.0, frame / 30)])
        solver.step(DT)
    moved = np.abs(positions(solver) - rest).max(axis=1)
    assert moved[lower].max() > 0.03
    gap = positions(solver)[upper, 2].min() - positions(solver)[lower, 2].max()
    assert gap > -0.05


def test_it_is_known_whether_anything_touches(device):
    """Boxes that overlap are no contact, and contacts end when bodies part."""
    rest, tets, _ = two_balls(0.095, 0.7)
    solver = make_solver(rest, tets, rest[:, 2] < rest[:, 2].min() + 0.1, device)
    top = np.flatnonzero(rest[:, 2] > rest[:, 2].max() - 0.1)
    found = []
    solver.grab(top)
    for height in (0.0, -0.25, 1.0):
        for _ in range(60):
            solver.move(rest[top] + [0.0, 0.0, height])
            solver.step(DT)
        found.append(solver._contact.found())
    assert found == [False, True, False]


def test_a_stack_of_boxes_stays():
    boxes = []
    for i in range(4):
        vertices, tets = box((3, 3, 3), 0.1)
        boxes.append((vertices + np.array([0.02 * (i % 2), 0.013 * (i % 3), 0.302 * i]), tets))
    rest, tets, slices = joined(*boxes)
    solver = make_solver(rest, tets, gravity=EARTH, ground=0.0)
    run(solver, 4.0)
    x = positions(solver)
    for i, part in enumerate(slices):
        moved = x[part].mean(axis=0) - rest[part].mean(axis=0)
        assert np.linalg.norm(moved[:2]) < 0.05
        assert abs(moved[2]) < 0.02 * (i + 1)
    for below, above in pairwise(slices):
        assert x[above, 2].min() - x[below, 2].max() > -0.03  # they bend under each other's weight
    settled = x
    run(solver, 4.0)
    assert np.abs(positions(solver) - settled).max() < 0.02


def slide(angle, friction, seconds):
    """How far a block slides down a pinned slope, and its speed at the end."""
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    slope, slope_tets = box((12, 4, 1), 0.1)
    block, block_tets = box((2, 2, 1), 0.083)
    slope, block = slope - [0.6, 0.2, 0.1], block + np.array([-0.287, -0.066, 0.001])
    rest, tets, (lower, upper) = joined((slope @ turn.T, slope_tets), (block @ turn.T, block_tets))
    pinned = np.zeros(len(rest), bool)
    pinned[lower] = True
    solver = make_solver(
        rest, tets, pinned, gravity=EARTH, friction=friction, material=Material(damping=0.0)
    )
    down = turn @ [1.0, 0.0, 0.0]
    run(solver, seconds)
    before = positions(solver)[upper].mean(axis=0) @ down
    run(solver, 0.1)
    now = positions(solver)[upper].mean(axis=0) @ down
    return now - rest[upper].mean(axis=0) @ down, (now - before) / 0.1


@pytest.mark.parametrize("friction", [0.3, 0.7])
def test_friction_holds_a_block_up_to_coulombs_angle(friction):
    limit = np.arctan(friction)
    way, speed = slide(limit - np.radians(2.0), friction, 0.9)
    assert way < 0.02
    assert speed < 0.005
    angle = limit + np.radians(2.0)
    way, speed = slide(angle, friction, 0.9)
    expected = 9.81 * (np.sin(angle) - friction * np.cos(angle))
    # Two degrees beyond the limit, a fifth of the speed is a hundredth of the friction.
    assert speed == pytest.approx(0.95 * expected, rel=0.25)


def test_without_friction_a_block_slides_freely():
    angle = np.radians(8.0)
    assert slide(angle, 0.0, 0.4)[1] == pytest.approx(9.81 * np.sin(angle) * 0.45, rel=0.1)


def test_linked_rings_stay_linked():
    rest, tets, rings = linked_rings()
    left = np.flatnonzero(rest[:, 0] < -0.2)
    right = np.flatnonzero(rest[:, 0] > 0.5)
    ids, ways = np.append(left, right), np.repeat([-1.5, 1.5], [len(left), len(right)])
    for contact, linked in ((True, 1.0), (False, 0.0)):
        solver = make_solver(rest, tets, material=Material(young_modulus=1e5), contact=contact)
        solver.grab(ids, 1e4, 200.0 / len(left))
        solver.move(rest[ids] + ways[:, None] * [1.0, 0.0, 0.0])
        run(solver, 2.0)
        lines = [positions(solver)[part].reshape(24, -1, 3).mean(axis=1) for part in rings]
        assert abs(linking_number(*lines)) == pytest.approx(linked, abs=0.1)


def deepest(vertices, tets):
    """The largest distance to the surface of a vertex that is inside a tet of other vertices."""
    faces, _ = boundary_faces(tets, tet_neighbours(tets))
    outside = np.unique(faces)
    inside = barycentric(vertices[outside], vertices[tets]).min(axis=-1) > 1e-6
    inside &= ~(tets[None] == outside[:, None, None]).any(axis=-1)
    depths = [0.0]
    for vertex in outside[inside.any(axis=1)]:
        others = faces[~(faces == vertex).any(axis=1)]
        a, b, c = (vertices[others[:, i]] for i in range(3))
        weights = closest_weights(vertices[vertex] - a, b - a, c - a)
        nearest = np.einsum("nk,nkj->nj", weights, np.stack([a, b, c], axis=1))
        depths.append(np.linalg.norm(vertices[vertex] - nearest, axis=1).min())
    return max(depths)


def test_boxes_that_are_apart_are_compared_only_when_they_can_have_met(monkeypatch):
    """And two balls that come together are seen when they meet."""
    rest, tets, (lower, upper) = two_balls(0.095, 1.0)
    solver = make_solver(rest, tets, material=Material(damping=0.0), rescue=False)
    looks, launch = [], Contact._launch

    def counted(contact, kernel, *inputs):
        looks.append(kernel is boxes.touch_kernel)
        launch(contact, kernel, *inputs)

    monkeypatch.setattr(Contact, "_launch", counted)
    velocities = np.zeros_like(rest)
    velocities[upper, 2] = -0.1
    solver.set_state(rest, velocities)
    gap = rest[upper, 2].min() - rest[lower, 2].max()
    frames = int(gap / 0.1 / DT) - 6
    run(solver, frames * DT)
    assert 2 <= sum(looks) < frames / 2
    for _ in range(12):
        run(solver, 0.1)
        assert deepest(positions(solver), tets) < 0.01
    assert solver.velocities.numpy()[lower, 2].mean() < -0.01


def test_a_handle_that_jumps_is_seen_one_frame_later(device):
    rest, tets, (_, upper) = two_balls(0.095, 1.0)
    solver = make_solver(rest, tets, device=device)
    solver.grab(np.arange(len(rest))[upper])
    solver.move(rest[upper])
    run(solver, 0.2)
    solver.move(rest[upper] - [0.0, 0.0, 0.42])
    solver.step(DT)
    solver.move(rest[upper] - [0.0, 0.0, 0.43])
    solver.step(DT)
    assert solver._contact._touching


def test_an_arm_that_is_pressed_into_its_body_does_not_go_in():
    rest, tets = body_with_arm()
    edge = np.linalg.norm(np.diff(rest[edges(tets)], axis=1)[:, 0], axis=1).mean()
    tip = np.flatnonzero((rest[:, 0] > 0.75) & (rest[:, 2] > 0.9))
    depths = {}
    for contact in (False, True):
        solver = make_solver(rest, tets, rest[:, 2] < 0.08, contact=contact)
        solver.grab(tip)
        for frame in range(150):
            solver.move(rest[tip] - [0.35 * min(1.0, frame / 60), 0.0, 0.0])
            solver.step(DT)
        depths[contact] = deepest(positions(solver), tets) / edge
    assert depths[False] > 0.5
    assert depths[True] < 0.05
    solver.release()
    run(solver, 3.0)
    assert np.abs(positions(solver) - rest).max() < 0.02


def test_bodies_that_start_in_each_other_part_without_being_thrown():
    rest, tets, (lower, upper) = two_balls(0.095, 1.0)
    solver = make_solver(rest, tets)
    state = rest.copy()
    state[upper, 2] -= 0.6
    solver.set_state(state)
    fastest = 0.0
    for _ in range(120):
        solver.step(DT)
        fastest = max(fastest, np.linalg.norm(solver.velocities.numpy(), axis=1).max())
    x = positions(solver)
    assert deepest(x, tets) < 0.02
    assert x[upper, 2].mean() - x[lower, 2].mean() > 0.45
    assert fastest < 10.0


@pytest.mark.parametrize("name", contact_modules())
def test_the_gpu_source_compiles_without_a_gpu(name, tmp_path):
    assert wp.compile_aot_module(wp.get_module(name), arch=90, module_dir=tmp_path)
