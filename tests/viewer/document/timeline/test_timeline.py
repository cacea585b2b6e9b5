"""The timeline: keys are hit, plays are the same each time, and all of it can be undone."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.document import Scene
from deformrf.viewer.document.timeline import keys as k


@pytest.fixture
def scene(ball):
    made = Scene(ball, "ball", "cpu")
    made.settings.grab_radius = 0.2
    return made


@pytest.fixture
def line(scene):
    return scene.timeline


def view(scene):
    return orbits.values_of(scene.orbit)


def vertices(scene):
    return scene.solver.vertices.numpy().copy()


def posed(scene, tick, by):
    """Key a pose in which the highest vertex is held `by` from where it was."""
    top = int(scene.solver.rest_vertices[:, 2].argmax())
    scene.handles.grab(top)
    scene.handles.drag_to(scene.solver.rest_vertices[top] + by)
    scene.clock.advance(0.1)
    scene.timeline.key(tick, None, True)
    scene.handles.release()
    return top


def played(scene, count):
    """The vertices after each of so many ticks."""
    shown = []
    for _ in range(count):
        scene.clock.tick()
        shown.append(vertices(scene))
    return shown


@pytest.fixture
def two_poses(scene, line):
    """Two pose keys, at ticks 0 and 20, whose top is held at different places."""
    top = posed(scene, 0, [-0.1, 0.0, 0.0])
    posed(scene, 20, [0.1, 0.0, 0.05])
    return top, *line.keys["pose"]


def ticks(line, track="camera"):
    return [key.tick for key in line.keys[track]]


# -- keys --------------------------------------------------------------------------------------


def test_keys_are_sorted_moved_copied_and_deleted(scene, line):
    for tick in (30, 0, 10):
        line.key(tick, view(scene), False)
    assert ticks(line) == [0, 10, 30]
    line.move_key("camera", 10, 40)
    line.copy_key("camera", 0, 50)
    line.delete_key("camera", 30)
    assert ticks(line) == [0, 40, 50] and line.end == 50
    assert line.keys["camera"][0].orbit is line.keys["camera"][2].orbit
    line.move_key("camera", 0, 50)  # onto another one, which it replaces
    assert ticks(line) == [40, 50]
    with pytest.raises(ValueError, match="no pose key at tick 3"):
        line.delete_key("pose", 3)


def test_edits_of_keys_are_undone_and_done_again(scene, line):
    line.key(0, view(scene), True)
    line.key(30, view(scene), False)
    line.ease_key("camera", 30, "hold")
    line.move_key("camera", 30, 35)
    line.set_loop(True)
    line.set_motion("physics")
    line.save_pose("rest")
    states = []
    while scene.journal.cursor:
        states.append(line.state())
        scene.undo()
    assert line.end == 0 and not any(line.keys.values()) and not line.loop and not line.poses
    for state in reversed(states):
        scene.redo()
        assert line.state() == state
    assert ticks(line) == [0, 35] and line.keys["camera"][1].easing == "hold"


def test_a_key_takes_the_easing_of_the_way_that_it_cuts(scene, line):
    line.key(0, view(scene), False)
    line.key(30, view(scene), False)
    line.ease_key("camera", 0, "linear")
    line.key(10, view(scene), False)
    assert [key.easing for key in line.keys["camera"]] == ["linear", "linear", "smooth"]


def test_a_timeline_holds_no_more_keys_than_it_can(scene, line, monkeypatch):
    monkeypatch.setattr("deformrf.viewer.document.timeline.timeline.MOST_KEYS", 2)
    line.key(0, None, True)
    line.key(1, None, True)
    with pytest.raises(ValueError, match="at most 2 pose keys"):
        line.key(2, None, True)
    line.key(1, None, True)  # in the place of one


# -- playing poses -----------------------------------------------------------------------------


def test_interpolated_poses_hit_their_keys_and_blend_between(scene, line, two_poses):
    _, first, second = two_poses
    line.ease_key("pose", 0, "linear")
    line.play()
    np.testing.assert_array_equal(vertices(scene), first.vertices)
    shown = played(scene, 20)
    np.testing.assert_allclose(shown[4], 0.75 * first.vertices + 0.25 * second.vertices, atol=1e-6)
    np.testing.assert_array_equal(shown[19], second.vertices)
    after = played(scene, 30)[-1]
    assert not line.playing and scene.clock.paused  # and the pose stays
    np.testing.assert_array_equal(after, second.vertices)


@pytest.mark.parametrize("easing", ["linear", "smooth"])
def test_physics_moves_what_is_held_along_its_way_and_the_rest_follows(
    scene, line, two_poses, easing
):
    top, first, second = two_poses
    line.ease_key("pose", 0, easing)
    line.set_motion("physics")
    line.play()
    shown = played(scene, 20)
    for tick, now in enumerate(shown, start=1):
        share = np.float32(k.EASINGS[easing](tick / 20))
        wanted = k.mixed(first.vertices, second.vertices, share)
        np.testing.assert_allclose(now[first.held], wanted[first.held], atol=1e-6)
    free = ~(first.held | second.held)
    blended = k.vertices_at(line.keys["pose"], 10)
    away = abs(shown[9] - blended)[free].max()
    assert 1e-3 < away < 0.3  # it lags, and follows
    assert (scene.solver.pinned == first.pinned).all()  # what the mouse held is none
    played(scene, 2)
    assert not line.playing and not scene.clock.paused
    assert (scene.solver.pinned == second.pinned).all()
    assert abs(played(scene, 60)[-1][top] - second.vertices[top]).max() > 0.01  # let go


def test_pins_that_move_between_keys_are_pins_again_at_the_end(scene, line):
    top = posed(scene, 0, [0.0, 0.0, 0.0])
    scene.handles.set_pin(top, True)
    line.key(0, None, True)
    scene.handles.set_pin(top, False)
    posed(scene, 9, [0.1, 0.0, 0.0])
    scene.handles.set_pin(top, True)
    line.key(10, None, True)
    second = line.keys["pose"][-1]
    line.set_motion("physics")
    line.play()
    played(scene, 5)
    assert line.taken_pins[top] and not scene.solver.pinned[top]
    line.ease_key("pose", 0, "linear")  # an edit meanwhile, and back
    scene.undo()
    assert scene.solver.pinned[top] and not line.playing
    line.play()
    played(scene, 12)
    np.testing.assert_array_equal(scene.solver.pinned, second.pinned)
    np.testing.assert_allclose(vertices(scene)[top], second.vertices[top], atol=1e-6)
    before = vertices(scene)[top]
    np.testing.assert_array_equal(played(scene, 30)[-1][top], before)


def test_a_loop_begins_again_where_it_began(scene, line, two_poses):
    line.set_loop(True)
    for motion in ("interpolation", "physics"):
        line.set_motion(motion)
        line.scrub(0)
        line.play()
        shown = played(scene, 61)
        np.testing.assert_array_equal(shown[19], two_poses[1].vertices)  # 20 is 0
        np.testing.assert_array_equal(shown[0:20], shown[20:40])
        assert line.playing
        line.stop()


def test_a_loop_that_closes_does_not_jump(scene, line, two_poses):
    line.copy_key("pose", 0, 40)
    line.set_loop(True)
    line.set_motion("physics")
    line.play()
    shown = played(scene, 100)
    steps = [abs(after - before).max() for before, after in pairwise(shown)]
    assert max(steps) < 0.06
    assert abs(shown[39] - two_poses[1].vertices).max() > 1e-4  # it was not set


def test_material_and_pins_follow_the_keys(scene, line):
    line.key(0, None, True)
    scene.body.set_material(young_modulus=4e6, damping=4.5)
    scene.handles.set_pin(int(scene.handles.control_ids[0]), True)
    line.key(20, None, True)
    line.ease_key("pose", 0, "linear")
    line.scrub(10)
    assert scene.body.material.young_modulus == pytest.approx(2e6)
    assert scene.body.material.damping == pytest.approx(4.0)
    pinned = scene.solver.pinned.sum()
    line.scrub(20)
    assert scene.body.material.young_modulus == 4e6 and scene.solver.pinned.sum() > pinned


def test_scrubbing_shows_the_pose_and_is_one_step(scene, line, two_poses):
    before, count = vertices(scene), len(scene.journal.steps)
    for tick in (3, 10, 20):
        line.scrub(tick)
        scene.clock.advance(1 / 60)
    np.testing.assert_array_equal(vertices(scene), two_poses[2].vertices)
    assert scene.clock.paused and len(scene.journal.steps) == count + 1
    scene.undo()
    np.testing.assert_array_equal(vertices(scene), before)
    assert line.head == 0


@pytest.mark.parametrize("motion", ["interpolation", "physics"])
def test_a_hand_stops_what_plays(scene, line, two_poses, motion):
    line.set_motion(motion)
    line.play()
    played(scene, 5)
    scene.handles.grab(two_poses[0])
    scene.handles.release()
    assert not line.playing
    played(scene, 3)
    line.play()
    played(scene, 5)
    scene.reset()
    assert not line.playing
    np.testing.assert_array_equal(vertices(scene), scene.solver.rest_vertices.astype("f4"))


def test_time_that_stands_still_stops_physics_but_no_camera(scene, line, two_poses):
    line.set_motion("physics")
    line.play()
    scene.clock.paused = True
    before = vertices(scene)
    np.testing.assert_array_equal(played(scene, 5)[-1], before)
    assert line.playing and line.head == 0
    scene.clock.paused = False
    played(scene, 5)
    assert line.head == 5


def test_a_hand_lets_time_go_on_that_the_timeline_stopped(scene, line, two_poses):
    """So that a pose that is shown can be changed; time that the user stopped stands still."""
    line.scrub(20)
    assert scene.clock.paused and line.stands
    scene.handles.grab(two_poses[0])
    assert not scene.clock.paused and not line.stands
    scene.handles.drag_to(scene.solver.rest_vertices[two_poses[0]])
    scene.clock.advance(0.1)
    line.key(20, None, True)
    scene.handles.release()
    moved = abs(line.keys["pose"][1].vertices - two_poses[2].vertices).max()
    assert moved > 0.05
    scene.clock.paused = True
    line.scrub(0)
    scene.handles.grab(two_poses[0])
    assert scene.clock.paused


@pytest.mark.parametrize("shown", ["scrub", "play", "blend_pose"])
def test_undo_lets_time_go_on_that_the_undone_edit_stopped(scene, line, two_poses, shown):
    line.save_pose("a")
    getattr(line, shown)(*{"scrub": [20], "play": [], "blend_pose": ["a", 0.5]}[shown])
    assert scene.clock.paused and line.stands
    scene.undo()
    assert not scene.clock.paused and not line.stands
    before = vertices(scene)
    assert (played(scene, 5)[-1] != before).any()
    scene.redo()
    shown = vertices(scene)
    assert scene.clock.paused and line.stands
    np.testing.assert_array_equal(played(scene, 5)[-1], shown)
    scene.undo()
    scene.clock.paused = True  # by the user: undo leaves it
    line.scrub(0)
    scene.undo()
    assert scene.clock.paused and not line.stands


def test_a_drag_that_is_given_up_leaves_time_standing_still(scene, line, two_poses):
    line.scrub(20)
    scene.handles.grab(two_poses[0])
    scene.handles.drag_to(scene.solver.rest_vertices[two_poses[0]])
    scene.clock.advance(0.1)
    scene.handles.cancel()
    assert scene.clock.paused and line.stands
    np.testing.assert_array_equal(played(scene, 30)[-1], two_poses[2].vertices)


@pytest.mark.parametrize("motion", ["interpolation", "physics"])
@pytest.mark.parametrize("act", ["set_pin", "hold"])
def test_pins_that_are_set_while_poses_play_stay(scene, line, two_poses, motion, act):
    line.set_motion(motion)
    line.play()
    played(scene, 5)
    top = two_poses[0]
    if act == "set_pin":
        scene.handles.set_pin(top, True)
    else:
        scene.hold(False)
    assert not line.playing
    played(scene, 30)
    pinned = scene.solver.pinned
    assert pinned[top] if act == "set_pin" else not pinned.any()
    assert scene.clock.paused == (motion == "interpolation")  # the pose that was shown stays


def test_a_pause_stops_the_playhead_of_poses_where_they_are(scene, line, two_poses):
    line.play()
    there = played(scene, 5)[-1]
    scene.clock.paused = not scene.clock.paused  # Space
    assert not line.playing and scene.clock.paused and line.head == 5
    np.testing.assert_array_equal(played(scene, 30)[-1], there)
    scene.clock.paused = not scene.clock.paused
    assert (played(scene, 5)[-1] != there).any()


def test_without_keys_nothing_plays(scene, line):
    line.play()
    assert not line.playing and not scene.clock.moving
    line.scrub(30)
    assert line.head == 30 and not scene.clock.paused


# -- saved poses -------------------------------------------------------------------------------


def test_saved_poses_blend_by_their_weights(scene, line):
    rest = vertices(scene)
    for name, by in (("left", [-0.1, 0.0, 0.0]), ("up", [0.0, 0.0, 0.1])):
        posed(scene, 0, by)
        line.save_pose(name)
        scene.reset()
    left, up = (pose.vertices for pose in line.poses)
    line.blend_pose("left", 1.0)
    np.testing.assert_allclose(vertices(scene), left, atol=1e-6)
    line.blend_pose("left", 0.5)
    line.blend_pose("up", -0.25)
    wanted = rest + 0.5 * (left - rest) - 0.25 * (up - rest)
    np.testing.assert_allclose(vertices(scene), wanted, atol=1e-6)
    np.testing.assert_allclose(played(scene, 5)[-1], wanted, atol=1e-6)
    labels = [step.label for step in scene.journal.steps]
    assert labels[-2:] == ["blend the pose left", "blend the pose up"]
    scene.undo()
    scene.undo()
    np.testing.assert_array_equal(vertices(scene), rest)
    line.delete_pose("left")
    with pytest.raises(ValueError, match="'left'"):
        line.blend_pose("left", 1.0)


def test_a_turntable_turns_evenly_all_around_and_loops(scene, line):
    scene.orbit = replace(scene.orbit, yaw=2.5, pitch=0.3)
    first = scene.orbit
    line.turntable(88, view(scene))
    assert line.loop and line.end == 88 and len(line.keys["camera"]) >= 2
    line.play()
    yaws = [scene.orbit.yaw]
    for _ in range(2 * 88):
        scene.clock.tick()
        yaws.append(scene.orbit.yaw)
    steps = (np.diff(yaws) + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(steps, 2 * np.pi / 88, atol=1e-6)
    assert scene.orbit.pitch == first.pitch and line.head == 0 and line.playing
