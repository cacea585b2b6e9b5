"""Pose: what a hand lets go stays there, and the rest of the object finds its equilibrium."""

import numpy as np
import pytest
from random_hands import use

from deformrf.core.deform import TIME_STEP
from deformrf.viewer.document import Player, Scene, load_session, save_session, start_of

WAY = np.array([0.08, 0.0, 0.0])


@pytest.fixture
def scene(ball):
    made = Scene(ball, "ball", "cpu")
    made.settings.grab_radius = 0.2
    made.handles.choose_hand("pose")
    return made


def topmost(scene):
    """The highest control point."""
    ids = scene.handles.control_ids
    return int(ids[scene.handles.at(ids)[:, 2].argmax()])


def wait(scene, frames):
    for _ in range(frames):
        scene.clock.advance(TIME_STEP)


def drag(scene, handle, way=WAY, frames=30):
    scene.handles.grab(handle)
    scene.handles.drag_to(scene.handles.at([handle])[0] + way)
    wait(scene, frames)
    scene.handles.let_go()


def place(scene, handle):
    return scene.handles.at([handle])[0]


@pytest.mark.parametrize("hand", ["physics", "pose"])
def test_what_is_let_go_swings_back_or_stays(scene, hand):
    scene.handles.choose_hand(hand)
    handle = topmost(scene)
    start = place(scene, handle)
    drag(scene, handle)
    assert (handle in scene.handles.posed) == (hand == "pose")
    wait(scene, 600)
    left = WAY if hand == "pose" else 0.0 * WAY
    np.testing.assert_allclose(place(scene, handle) - start, left, atol=1e-3)
    assert handle in scene.handles.control_ids and scene.solver.settled


def test_a_posed_handle_is_no_pin_and_can_be_dragged_again(scene):
    handle, pins = topmost(scene), scene.handles.pin_ids
    drag(scene, handle)
    np.testing.assert_array_equal(scene.handles.pin_ids, pins)
    before = place(scene, handle)
    drag(scene, handle, -0.5 * WAY)
    assert scene.handles.posed == (handle,)
    np.testing.assert_allclose(place(scene, handle) - before, -0.5 * WAY, atol=1e-5)


def test_a_drag_that_is_given_up_leaves_a_posed_handle_where_it_was(scene):
    handle = topmost(scene)
    drag(scene, handle)
    posed, pinned = scene.handles.posed, scene.solver.pinned.copy()
    before = place(scene, handle)
    scene.handles.grab(handle)
    assert not scene.handles.posed and scene.solver.pinned.sum() < pinned.sum()
    scene.handles.drag_to(before + WAY)
    wait(scene, 5)
    scene.handles.cancel()
    wait(scene, 30)
    assert scene.handles.posed == posed
    np.testing.assert_array_equal(scene.solver.pinned, pinned)
    np.testing.assert_allclose(place(scene, handle), before, atol=1e-6)


@pytest.mark.parametrize("by", ["click", "reset", "undo"])
def test_it_is_let_go_by(scene, by):
    handle = topmost(scene)
    start = place(scene, handle)
    drag(scene, handle)
    if by == "click":
        scene.handles.set_pin(handle, False)
    else:
        getattr(scene, by)()
    wait(scene, 600)
    assert not scene.handles.posed and not scene.handles.patches.any()
    np.testing.assert_array_equal(scene.solver.pinned, scene.pins)
    np.testing.assert_allclose(place(scene, handle), start, atol=1e-3)


def test_undo_and_redo_of_two_poses(scene):
    first = topmost(scene)
    drag(scene, first)
    second = int(scene.handles.control_ids[0])
    drag(scene, second, -WAY)
    assert scene.handles.posed == (first, second)
    scene.undo()
    assert scene.handles.posed == (first,)
    scene.redo()
    assert scene.handles.posed == (first, second)
    scene.handles.set_pin(first, True)  # P: from now on it is a pin
    assert scene.handles.posed == (second,)


def test_the_object_is_pinned_or_freed_as_a_whole(scene):
    handle = topmost(scene)
    drag(scene, handle)
    scene.hold(True)
    assert scene.handles.posed == (handle,)
    scene.handles.set_pin(handle, False)
    np.testing.assert_array_equal(scene.solver.pinned, scene.pins)
    drag(scene, handle)
    scene.hold(False)
    assert not scene.handles.posed and not scene.solver.pinned.any()


@pytest.mark.parametrize("hand", ["physics", "pose"])
def test_while_time_is_stopped_a_drag_poses(scene, hand):
    """In Pose the rest goes along to its equilibrium; in Physics nothing moves before Space."""
    scene.handles.choose_hand(hand)
    handle, before = topmost(scene), scene.positions.copy()
    scene.clock.paused = True
    drag(scene, handle, frames=60)
    pinned = scene.solver.pinned
    moved = np.linalg.norm(scene.positions - before, axis=1) / scene.size
    assert (moved[~pinned].max() > 0.02) == (hand == "pose")
    wait(scene, 300)
    assert not scene.clock.moving  # also not in Pose: it has arrived
    paused = scene.positions.copy()
    scene.clock.paused = False
    wait(scene, 300)
    off = np.abs(scene.positions - paused).max() / scene.size
    assert off < 0.01 if hand == "pose" else moved.max() == 0.0


class Hands:
    """Random hands in both modes."""

    def __init__(self, scene, random):
        self.scene, self.random = scene, random

    def drag(self):
        handles = self.scene.handles
        if handles.grabbed is None:
            handles.grab(int(self.random.choice(handles.control_ids)))
        else:
            way = self.random.normal(scale=0.05, size=3)
            handles.drag_to(handles.grabbed.target.place + way)

    def grab_place(self):
        scene = self.scene
        if scene.handles.grabbed is None:
            point = int(self.random.integers(len(scene.handles.points)))
            scene.handles.grab_place(scene.handles.points.at(scene.positions)[point] + 1e-3)

    def click(self):
        handles = self.scene.handles
        if handles.posed and handles.grabbed is None:
            handles.set_pin(int(self.random.choice(handles.posed)), False)

    def edits(self):
        scene, random = self.scene, self.random
        return (
            *(self.drag,) * 5,
            *(self.grab_place,) * 2,
            *(scene.handles.let_go,) * 3,
            self.click,
            scene.handles.cancel,
            lambda: scene.handles.choose_hand(str(random.choice(["physics", "pose"]))),
            lambda: setattr(scene.clock, "paused", bool(random.integers(2))),
            lambda: scene.hold(bool(random.integers(3))),
            scene.handles.pin_grab,
            scene.reset,
            scene.undo,
            scene.redo,
        )


@pytest.mark.parametrize("trial", range(3))
def test_random_poses_play_again_to_the_bit_and_undo_to_the_beginning(ball, tmp_path, trial):
    scene = Scene(ball, "ball", "cpu")
    seed = int(np.random.default_rng().integers(2**32))
    random, start = np.random.default_rng(seed), start_of(scene)
    before = scene.solver.vertices.numpy().copy()
    use(scene, random, Hands(scene, random).edits(), 150, most_frames=4)
    session = load_session(save_session(scene, start, tmp_path / "s.jsonl"), ball)
    other = Scene(ball, "ball", "cpu")
    Player(other, session).play_to(session.ticks)
    for one, two in (
        (other.solver.vertices.numpy(), scene.solver.vertices.numpy()),
        (other.solver.pinned, scene.solver.pinned),
        (other.handles.patches, scene.handles.patches),
        (other.handles.points.corners, scene.handles.points.corners),
    ):
        np.testing.assert_array_equal(one, two, f"seed {seed}")
    assert other.handles.posed == scene.handles.posed, f"seed {seed}"
    assert other.journal.events == scene.journal.events, f"seed {seed}"
    while scene.journal.cursor:
        scene.undo()
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), before, f"seed {seed}")
    assert not scene.handles.posed, f"seed {seed}"


@pytest.mark.parametrize("hand", ["physics", "pose"])
def test_pins_that_are_selected_are_moved_and_pinned_again(scene, ball, tmp_path, hand):
    """Beside one that is free, which is let go as the switch says."""
    begin = start_of(scene)
    scene.handles.choose_hand(hand)
    scene.settings.grab_radius = 0.05
    ids = scene.handles.control_ids
    pin, free = (int(ids[scene.handles.at(ids)[:, 0].argmin()]), topmost(scene))
    scene.handles.set_pin(pin, True)
    scene.handles.select([pin, free])
    assert scene.handles.movable == [free] and scene.handles.takeable == [pin, free]
    before, pinned = scene.handles.at([pin, free]), scene.solver.pinned.copy()
    scene.handles.grab_selected()
    scene.handles.cancel()
    np.testing.assert_array_equal(scene.solver.pinned, pinned)
    scene.handles.grab_selected()
    scene.handles.drag_to(before[0] + WAY)
    wait(scene, 30)
    np.testing.assert_allclose(scene.handles.at([pin, free]), before + WAY, atol=1e-5)
    scene.handles.let_go()
    assert scene.handles.is_pinned(pin) and pin not in scene.handles.posed
    assert (free in scene.handles.posed) == (hand == "pose") == scene.handles.is_pinned(free)
    wait(scene, 60)
    np.testing.assert_allclose(place(scene, pin), before[0] + WAY, atol=1e-5)
    session = load_session(save_session(scene, begin, tmp_path / "s.jsonl"), ball)
    other = Scene(ball, "ball", "cpu")
    Player(other, session).play_to(session.ticks)
    np.testing.assert_array_equal(other.solver.vertices.numpy(), scene.solver.vertices.numpy())
    scene.undo()
    np.testing.assert_array_equal(scene.solver.pinned, pinned)
