"""The rescue: when it begins and ends, and where it takes a part."""

import numpy as np
import pytest

from deformrf.core.deform import distortion
from deformrf.core.deform.rescue import (
    DURATION,
    FORGET,
    PATIENCE,
    RATIO,
    SOFTENING,
    TRIES,
    Rescue,
    goals,
)
from deformrf.core.geometry import signed_volumes

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


def test_a_part_that_pins_hold_in_a_tangle_collides_with_nothing_until_the_user_acts():
    rescue, parts = Rescue(), np.ones(2, bool)
    for counts, out in (
        ([5, 0], False),
        ([0, 1], False),
        ([5, 0], False),
        ([5, 0], True),
        ([0, 0], True),
    ):
        rescue.advance(0.5, "pins")
        rescue.report(np.array(counts))
        assert rescue.without_contact(parts).tolist() == [out, False]
    rescue.touch()
    assert not rescue.without_contact(parts).any()
    rescue.report(np.zeros(2, int))
    for _ in range(5):
        rescue.advance(0.5, "weight")
        rescue.report(np.array([5, 1]))
    assert not rescue.without_contact(parts).any()


def first_try(rescue, tangles, stuck):
    """Report until a try begins: "softening" or "straight"."""
    for _ in range(20):
        rescue.advance(0.5)
        rescue.report(np.array([tangles]), stuck=np.array([stuck]))
        if rescue.running:
            return "straight" if rescue.ratio is None else "softening"
    raise AssertionError("no try began")


def test_what_is_stuck_without_a_tangle_takes_no_softening():
    assert first_try(Rescue(), 0, 1) == "straight"
    assert first_try(Rescue(), 1, 1) == "softening"


def test_a_try_for_a_stuck_part_leaves_a_tangle_its_softening():
    rescue = Rescue()
    assert first_try(rescue, 0, 1) == "straight"
    while rescue.running:
        rescue.advance(0.5)
    assert first_try(rescue, 1, 0) == "softening"
