"""The rescue: when it begins and ends, and that every tangled body returns to its rest shape."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.deform import Material, XpbdOptions, XpbdSolver
from deformrf.core.deform.rescue import (
    DURATION,
    FORGET,
    PATIENCE,
    RATIO,
    SOFTENING,
    TRIES,
    Rescue,
    distortion,
    goals,
)
from deformrf.core.geometry import a15_grid, extract, signed_volumes

DT = 1.0 / 60.0


class Body:
    """Stands in for the solver: `counts` says how many tangles each part has after each frame."""

    def __init__(self, *counts):
        self.rescue, self.counts, self.load, self.lost = Rescue(), np.array(counts), None, False
        self.progress = []  # of every frame; 0 while there is no rescue

    def run(self, seconds, dt=DT):
        for _ in range(round(seconds / dt)):
            counted = self.rescue.advance(dt, self.load)
            self.progress.append(self.rescue.progress if self.rescue.parts is not None else 0.0)
            if counted:
                self.rescue.report(self.counts, self.lost)


FRAMES = pytest.mark.parametrize("dt", [1 / 144, 1 / 60, 1 / 5, 1.0])


def run_until(body, attribute, dt=DT):
    """Run until a try of one kind is under way; the seconds that took."""
    before = len(body.progress)
    while getattr(body.rescue, attribute) is None:
        body.run(dt, dt)
        assert len(body.progress) - before < 20 / dt
    return (len(body.progress) - before) * dt


@FRAMES
def test_after_a_second_of_tangles_it_is_softened(dt):
    body = Body(0, 3)
    assert PATIENCE <= run_until(body, "ratio", dt) <= PATIENCE + 4 * dt
    assert body.rescue.ratio == RATIO and body.rescue.running
    softened = 0
    while body.rescue.ratio is not None:
        assert not body.rescue.may_sleep
        body.run(dt, dt)
        softened += 1
    assert softened * dt == pytest.approx(SOFTENING, abs=dt)
    body.counts[:] = 0
    body.run(5.0, dt)
    assert not any(body.progress) and body.rescue.may_sleep


@FRAMES
def test_parts_that_stay_tangled_are_taken_back_once(dt):
    body = Body(0, 3)
    run_until(body, "ratio", dt)
    assert run_until(body, "parts", dt) <= SOFTENING + PATIENCE + 6 * dt
    np.testing.assert_array_equal(body.rescue.parts, [False, True])
    assert body.rescue.ratio is None
    body.counts[:] = 0
    body.run(5.0, dt)
    way = np.array(body.progress)
    way = way[way > 0]
    assert (np.diff(way) > 0).all() and way[-1] == 1.0
    assert len(way) == pytest.approx(DURATION / dt, abs=1.0)
    assert not body.rescue.running and body.rescue.may_sleep


def test_a_sound_mesh_is_left_alone_and_may_sleep():
    body = Body(0, 0)
    assert not body.rescue.may_sleep  # nobody has looked yet
    body.run(3.0)
    assert not any(body.progress)
    assert body.rescue.may_sleep


def test_tangles_that_resolve_themselves_start_no_rescue():
    body = Body(5)
    for _ in range(5):
        body.counts[:] = 5
        body.run(0.8 * PATIENCE)
        body.counts[:] = 0
        body.run(0.5)
    assert not any(body.progress)


def test_after_all_tries_nothing_happens_until_the_user_acts():
    body = Body(3)
    body.run(60.0)
    assert body.progress.count(1.0) == TRIES - 1  # the first one was softened
    assert body.rescue.may_sleep and body.rescue.given_up
    body.rescue.touch()
    assert not body.rescue.given_up
    assert not body.rescue.may_sleep
    run_until(body, "ratio")


def test_a_body_that_tangles_by_its_weight_is_given_up():
    body = Body(3)
    for _ in range(2 * TRIES):  # it is untangled by the rescue, and gives way again
        body.counts[:] = 3
        while body.rescue.parts is None and len(body.progress) < 3000:
            body.run(DT)
        body.counts[:] = 0
        body.run(DURATION + 1.0)
    assert body.progress.count(1.0) == TRIES - 1
    body.run(FORGET)
    body.counts[:] = 3
    run_until(body, "ratio")  # as if nothing had been
    run_until(body, "parts")


def test_what_gives_way_under_its_weight_is_not_pulled():
    body = Body(0)
    body.load = "weight"
    body.run(1.0)
    assert body.rescue.held_by is None
    body.counts[:] = 3
    body.run(30.0)
    assert not any(body.progress) and body.rescue.ratio is None
    assert body.rescue.held_by == "weight" and body.rescue.may_sleep and not body.rescue.given_up
    body.load = None  # gravity is taken away: now nothing holds it
    run_until(body, "ratio")
    assert body.rescue.held_by is None


def test_what_a_drag_tangled_is_rescued_under_its_weight_too():
    body = Body(3)
    body.load = "weight"
    run_until(body, "ratio")
    run_until(body, "parts")


def test_what_pins_bend_is_not_pulled_but_what_is_lost_comes_back():
    body = Body(3, 5)
    body.load = "pins"
    body.run(30.0)
    assert not any(body.progress) and body.rescue.held_by == "pins" and body.rescue.may_sleep
    body.lost = np.array([False, True])
    run_until(body, "parts")
    np.testing.assert_array_equal(body.rescue.parts, [False, True])


def turned(vertices):
    """Vertices after a random rotation and translation."""
    random = np.random.default_rng()
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    return vertices @ (turn * np.sign(np.linalg.det(turn))) + random.normal(size=3)


def test_the_goal_is_the_rest_shape_in_the_current_rotation():
    rest = np.random.default_rng().uniform(size=(20, 3))
    nobody, x = np.zeros(20, bool), turned(rest)
    np.testing.assert_allclose(goals(rest, x, nobody), x, atol=1e-12)
    lost = x.copy()
    lost[3], lost[5, 1] = np.nan, np.inf
    np.testing.assert_allclose(goals(rest, lost, nobody), x, atol=1e-12)
    np.testing.assert_array_equal(goals(rest, np.full_like(x, np.nan), nobody), rest)


@pytest.mark.parametrize("scale", [(-1, 1, 1), (1, 1, 0), (1, 0, 0), (0, 0, 0)])
def test_the_goal_of_a_mirrored_or_collapsed_body_is_neither(scale):
    rest = np.random.default_rng().uniform(size=(20, 3))
    goal = goals(rest, turned(rest * scale), np.zeros(20, bool))
    lengths, expected = (np.linalg.norm(a[:, None] - a[None], axis=2) for a in (goal, rest))
    np.testing.assert_allclose(lengths, expected, atol=1e-9)
    corners = np.array([[0, 1, 2, 3]])
    np.testing.assert_allclose(signed_volumes(goal, corners), signed_volumes(rest, corners))


def test_held_vertices_decide_where_the_goal_is():
    random = np.random.default_rng()
    rest = random.uniform(size=(20, 3))
    held = np.arange(20) < 4
    x = turned(rest)
    torn = np.where(held[:, None], x, x + random.normal(scale=3.0, size=x.shape))
    np.testing.assert_allclose(goals(rest, torn, held), x, atol=1e-3)


def test_a_rigid_motion_is_no_distortion():
    rest = np.random.default_rng().uniform(size=(20, 3))
    assert distortion(rest, turned(rest)) < 1e-9
    assert distortion(rest[:0], rest[:0]) == 0.0
    bent = turned(rest)
    bent[4] += 0.5
    assert 0.3 < distortion(rest, bent) < 0.9


# -- bodies --------------------------------------------------------------------------------


def pillar():
    """About 200 tets, upright, with a thin neck."""
    mesh = a15_grid(0.05)
    middle = mesh.rest_vertices[mesh.tets].mean(axis=1)
    height = (middle[:, 2] - 0.2) / 0.6
    radius = np.where(height < 0.15, 0.18, np.where(height < 0.5, 0.09, 0.15))
    away = np.linalg.norm(middle[:, :2] - 0.5, axis=1)
    return extract(mesh, (away < radius) & (height > 0) & (height < 1))[0]


MESH = pillar()
REST = MESH.rest_vertices
FOOT = REST[:, 2] < REST[:, 2].min() + 0.05 * np.ptp(REST[:, 2])
FREE = np.zeros(MESH.vertex_count, bool)


def make_solver(device, material, pinned=FOOT, **options):
    return XpbdSolver(REST, MESH.tets, material, pinned, XpbdOptions(**options), device)


def from_rest(positions, pinned):
    """The farthest that a vertex is from the rest pose, after a rotation if nothing is pinned."""
    x, rest = positions - positions.mean(axis=0), REST - REST.mean(axis=0)
    if pinned.any():
        x, rest = positions, REST
    else:
        u, _, vt = np.linalg.svd(x.T @ rest)
        x = x @ u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return np.linalg.norm(x - rest, axis=1).max() / np.ptp(REST, axis=0).max()


def start_of(name):
    """The rest pose, mirrored, collapsed or random.  [V, 3]"""
    center = REST.mean(axis=0)
    if name == "random":
        return np.random.default_rng().uniform(0.2, 0.8, REST.shape)
    scale = {"mirrored": [-1, 1, 1], "plane": [1, 1, 0], "line": [0, 0, 1], "point": [0, 0, 0]}
    return center + (REST - center) * scale[name]


@pytest.mark.parametrize("pinned", [FREE, FOOT], ids=["free", "pinned"])
@pytest.mark.parametrize("start", ["mirrored", "plane", "line", "point", "random"])
def test_without_volume_constraints_every_start_comes_back(device, start, pinned):
    x = make_solver(device, Material(poisson_ratio=0.25), pinned)
    spoiled = start_of(start)
    spoiled[pinned] = REST[pinned]
    x.set_state(spoiled)
    for _ in range(600):
        x.step(DT)
    now = x.vertices.numpy().astype(np.float64)
    assert (signed_volumes(now, MESH.tets) > 0).all()
    assert from_rest(now, pinned) < 0.01
    assert not x.rescue.counts.any()


def test_a_body_turned_inside_out_at_its_pins_comes_back_in_time(device):
    x = make_solver(device, Material(young_modulus=1e9))
    bottom = REST[:, 2].min()
    x.set_state(np.where(FOOT[:, None], REST, REST * [1, 1, -1] + [0, 0, 2 * bottom]))
    for _ in range(600):
        x.step(DT)
    assert from_rest(x.vertices.numpy().astype(np.float64), FOOT) < 0.01


@pytest.mark.parametrize("way", [(0.5, 0, 0), (0, 0.6, 0), (0, 0, -0.6), (10, 0, 0)])
def test_a_neck_that_a_drag_mirrored_returns_within_ten_seconds(device, way):
    """At a Poisson's ratio of 1/4; without the rescue it would stay 25 % away."""
    x = make_solver(device, Material(poisson_ratio=0.25))
    head = np.flatnonzero(REST[:, 2] > REST[:, 2].max() - 0.06)
    x.grab(head)
    for frame in range(30):
        x.move(REST[head] + np.array(way) * (frame + 1) / 30)
        x.step(DT)
    x.release()
    for _ in range(600):
        x.step(DT)
    assert from_rest(x.vertices.numpy().astype(np.float64), FOOT) < 0.01


def test_a_body_that_hangs_turned_over_at_its_pins_comes_back(device):
    """Its volumes are positive and no edge is wrapped, but many are twice as long."""
    x = make_solver(device, Material(young_modulus=1e4, poisson_ratio=0.45))
    low = REST[FOOT, 2].max()
    turned_over = REST * [1, -1, -1] + [0, 2 * REST[:, 1].mean(), 2 * low]  # half a turn
    x.set_state(np.where(FOOT[:, None], REST, turned_over))
    for _ in range(600):
        x.step(DT)
    assert from_rest(x.vertices.numpy().astype(np.float64), FOOT) < 0.01


def test_pins_that_stretch_a_body_are_no_tangle(device):
    """Pulled and pinned there, part of its neck is twice as long; it stays."""
    x = make_solver(device, Material())
    head = REST[:, 2] > REST[:, 2].max() - 0.06
    ids = np.flatnonzero(head)
    x.grab(ids)
    for frame in range(60):
        x.move(REST[ids] + np.array([0.0, 0.0, 0.8 * np.ptp(REST[:, 2])]) * (frame + 1) / 60)
        x.step(DT)
    x.set_pinned(FOOT | head)
    x.release()
    for _ in range(180):
        x.step(DT)
        assert not x.rescue.running
    ends = x.edges.vertices
    now = x.vertices.numpy()[ends]
    stretched = np.linalg.norm(now[:, 0] - now[:, 1], axis=1) / x.edges.rest_values
    assert (stretched > 2.0).sum() > 5


def test_a_body_that_falls_over_its_pins_is_left_lying(device):
    """Too soft for its weight: it tangles, and nothing pulls it up."""
    x = make_solver(device, Material(young_modulus=3e4))
    x.set_options(replace(x.options, gravity=(0.0, 0.0, -9.81)))
    for _ in range(1200):
        x.step(DT)
        assert not x.rescue.running
    assert x.rescue.held_by == "weight"
    assert from_rest(x.vertices.numpy().astype(np.float64), FOOT) > 0.1


def test_a_rescue_is_reported_and_the_solver_stays_awake(device):
    x = make_solver(device, Material(poisson_ratio=0.25), FREE)
    x.set_state(start_of("mirrored"))  # without volumes that is an equilibrium
    rescued = 0
    for _ in range(150):
        assert not x.settled
        x.step(DT)
        rescued += x.rescue.running
    assert rescued == pytest.approx(SOFTENING / DT, abs=1)  # volumes turn a mirror image over
    for _ in range(240):
        x.step(DT)
    assert not x.rescue.counts.any() and x.settled


def test_only_tangled_parts_are_taken_back(device):
    rest = np.concatenate([REST, REST + np.array([1.0, 0.0, 0.0])])
    tets = np.concatenate([MESH.tets, MESH.tets + len(REST)])
    x = XpbdSolver(
        rest, tets, Material(poisson_ratio=0.25), np.zeros(len(rest), bool), device=device
    )
    spoiled = rest.copy()
    spoiled[: len(REST)] = start_of("mirrored")
    velocities = np.zeros_like(rest)
    velocities[len(REST) :] = [0.0, 0.5, 0.0]
    x.set_state(spoiled, velocities)
    for _ in range(70):
        x.step(DT)
    assert x.rescue.running
    moving = x.velocities.numpy()[len(REST) :]
    np.testing.assert_allclose(moving[:, 1], 0.5, rtol=1e-3)
    for _ in range(400):
        x.step(DT)
    assert from_rest(x.vertices.numpy()[: len(REST)], FREE) < 0.01


def test_a_vertex_at_nan_is_recovered(device):
    x = make_solver(device, Material(), FREE)
    x.set_state(REST)
    spoiled = x.vertices.numpy().copy()
    spoiled[7] = np.nan
    x.vertices.assign(spoiled)
    for _ in range(360):
        x.step(DT)
    assert from_rest(x.vertices.numpy().astype(np.float64), FREE) < 1e-5


def test_without_the_rescue_a_mirror_image_sleeps(device):
    x = make_solver(device, Material(poisson_ratio=0.25), FREE, rescue=False)
    x.set_state(start_of("mirrored"))
    for _ in range(60):
        x.step(DT)
    assert x.settled and not x.rescue.running


def test_a_grab_stops_the_rescue(device):
    x = make_solver(device, Material(poisson_ratio=0.25), FREE)
    mirrored = start_of("mirrored")
    x.set_state(mirrored)
    x.grab([0])
    for _ in range(90):
        x.step(DT)
        assert not x.rescue.running
    x.release()
    for _ in range(70):
        x.step(DT)
    assert x.rescue.running
    x.grab([0])
    x.step(DT)
    assert not x.rescue.running
    moving = np.linalg.norm(x.velocities.numpy(), axis=1)
    assert (moving[1:] > 0).all()  # they have their masses again


def test_inverted_tets_are_counted(device):
    x = make_solver(device, Material(), FREE)
    moved = REST.copy()
    moved[np.random.default_rng().integers(len(moved), size=5)] += 0.3
    x.set_state(moved, velocities=np.zeros_like(moved))
    x._feedback.end(x.vertices, count=True)
    _, (inverted, *_) = x._feedback.read()
    expected = (signed_volumes(moved.astype(np.float32), MESH.tets) <= 0).sum()
    assert inverted.sum() == expected > 0
