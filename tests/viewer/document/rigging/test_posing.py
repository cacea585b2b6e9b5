"""What bones do to the object: poses, clips, softness, the timeline."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.deform import TIME_STEP
from deformrf.viewer.document import Scene
from deformrf.wings import rig
from deformrf.wings.rig.skeleton import skinning_matrices


@pytest.fixture
def scene(ball):
    """The ball with a bone in its lower and one in its upper half."""
    made = Scene(ball, "ball", "cpu")
    for height in (0.1, 0.5, 0.9):
        made.rigging.add_joint(np.array([0.5, 0.5, height]))
    return made


def turn(scene, bone=1, rotation=(0.7, 0.0, 0.0)):
    """Turn a bone, as a hand does."""
    scene.posing.hold_bone(bone)
    scene.posing.aim(rig.turned(scene.rigging.skeleton, scene.posing.current, bone, rotation))
    scene.posing.follow()


def vertices(scene):
    return scene.solver.vertices.numpy().copy()


def make_clip(scene):
    """A clip "bend" of half a second, from rest to a turned bone."""
    scene.posing.rest_bones([0, 1])
    scene.timeline.key(0, None, True)
    turn(scene)
    scene.timeline.key(30, None, True)
    scene.rigging.save_clip("bend")


def test_the_object_is_where_skinning_puts_it_and_stays(scene, ball):
    turn(scene)
    matrices = skinning_matrices(scene.rigging.skeleton, scene.posing.pose)
    weights = scene.rigging.rig.weights
    wanted = rig.skinned(ball.mesh.rest_vertices, weights, matrices)
    assert scene.rigging.rig.offsets is None
    np.testing.assert_allclose(vertices(scene), wanted, atol=1e-5)
    for _ in range(10):
        scene.clock.advance(0.05)
    np.testing.assert_allclose(vertices(scene), wanted, atol=1e-5)


def test_the_tip_of_two_bones_is_reached_and_drawn_there(scene):
    goal = np.array([0.7, 0.5, 0.6])
    scene.posing.hold_bone(1)
    scene.posing.aim(rig.reach(scene.rigging.skeleton, scene.posing.current, 1, goal))
    scene.posing.follow()
    assert scene.posing.ends[1, 1] == pytest.approx(goal)
    (tip,) = [one for one in scene.rigging.joints if one.name == (1, "tail")]
    assert tip.place == pytest.approx(goal)


def test_a_hand_on_a_red_point_takes_over_and_the_object_springs_back(scene):
    turn(scene)
    bent = vertices(scene)
    assert scene.clock.paused
    scene.handles.grab(int(scene.handles.control_ids[0]))
    assert not scene.clock.paused and not scene.posing.drives
    scene.handles.release()
    for _ in range(200):
        scene.clock.advance(0.05)
    rest = scene.field.mesh.rest_vertices
    assert abs(vertices(scene) - rest).mean() < 0.7 * abs(bent - rest).mean()  # pins were moved


def test_a_soft_object_lags_behind_its_bones_and_comes(scene):
    turn(scene)
    wanted = vertices(scene)
    scene.reset()
    scene.posing.set_softness(0.8)
    turn(scene)
    scene.clock.advance(TIME_STEP)
    driven = scene.grip.bones
    assert 0 < len(driven) < len(wanted)
    np.testing.assert_allclose(vertices(scene)[driven], wanted[driven], atol=1e-5)
    others = np.setdiff1d(np.arange(len(wanted)), driven)
    late = abs(vertices(scene) - wanted)[others].max()
    for _ in range(100):
        scene.clock.advance(0.05)
    assert abs(vertices(scene) - wanted)[others].max() < 0.5 * late


def test_pins_are_off_while_a_soft_object_is_posed_and_back_after(scene):
    scene.posing.set_softness(0.5)
    pins = scene.solver.pinned.copy()
    turn(scene, 0)
    assert not scene.solver.pinned.any()
    scene.reset()
    np.testing.assert_array_equal(scene.solver.pinned, pins)


def test_a_drag_and_soft_bones_act_at_once(scene):
    scene.posing.set_softness(0.9)
    turn(scene)
    free = [
        one
        for one in scene.handles.control_ids
        if not np.isin(scene.handles.corners(one), scene.grip.bones).any()
    ]
    scene.settings.grab_radius = 0.0
    scene.handles.grab(int(free[0]))
    goal = scene.handles.at([free[0]])[0] + [0.0, 0.0, 0.1]
    scene.handles.drag_to(goal)
    for _ in range(20):
        scene.clock.advance(TIME_STEP)
    assert scene.handles.at([free[0]])[0] == pytest.approx(goal, abs=1e-3)
    assert scene.posing.drives and len(scene.grip.bones)


def test_a_clip_from_the_timeline_plays_the_same_poses(scene):
    make_clip(scene)
    (clip,) = scene.rigging.clips
    assert clip.duration == pytest.approx(0.5)
    scene.timeline.scrub(20)
    wanted = vertices(scene)
    scene.posing.scrub_clip("bend", 20 / 60)
    np.testing.assert_allclose(vertices(scene), wanted, atol=1e-5)


def test_a_clip_plays_again_and_again_or_once_and_at_its_speed(scene):
    make_clip(scene)
    posing = scene.posing
    posing.scrub_clip("bend", 0.0)
    posing.play_clip("bend")
    for _ in range(45):
        scene.clock.tick()
    assert posing.playing and posing.seconds == pytest.approx(0.25)
    posing.set_clip_speed(-2.0)
    for _ in range(3):
        scene.clock.tick()
    assert posing.seconds == pytest.approx(0.15)
    posing.loop_clip(False)
    for _ in range(10):
        scene.clock.tick()
    assert not posing.playing and posing.seconds == 0.0


def test_a_clip_that_plays_fades_into_the_next_one(scene):
    make_clip(scene)
    turn(scene, 1, (0.0, -0.9, 0.0))
    scene.timeline.key(0, None, True)
    scene.timeline.key(30, None, True)
    scene.rigging.save_clip("lean")  # which stands
    posing = scene.posing
    posing.scrub_clip("lean", 0.0)
    lean = vertices(scene)
    posing.scrub_clip("bend", 0.0)
    posing.play_clip("bend")
    for _ in range(10):
        scene.clock.tick()
    ways = [vertices(scene)]
    posing.play_clip("lean")
    np.testing.assert_allclose(vertices(scene), ways[0], atol=1e-6)  # no jump
    for _ in range(25):
        scene.clock.tick()
        ways.append(vertices(scene))
    steps = abs(np.diff(ways, axis=0)).max(axis=(1, 2))
    assert steps.max() < 0.25 * abs(lean - ways[0]).max()
    np.testing.assert_allclose(ways[-1], lean, atol=1e-6)


def test_the_camera_turns_around_a_clip_that_plays(scene):
    from deformrf.viewer.camera import orbit as orbits

    make_clip(scene)
    scene.timeline.delete_key("pose", 0)
    scene.timeline.delete_key("pose", 30)
    scene.posing.play_clip("bend")
    scene.timeline.turntable(60, orbits.values_of(scene.orbit))
    yaw, seconds = scene.orbit.yaw, scene.posing.seconds
    scene.clock.advance(0.05)
    assert scene.orbit.yaw != yaw and scene.posing.seconds != seconds


def test_between_two_keys_of_bones_the_object_turns_and_keeps_its_size(scene):
    """Straight ways of vertices would flatten half a turn."""
    scene.posing.rest_bones([0, 1])
    scene.timeline.key(0, None, True)
    turn(scene, 0, (0.0, 0.9 * np.pi, 0.0))
    scene.timeline.key(20, None, True)
    scene.timeline.scrub(10)
    rest, now = scene.field.mesh.rest_vertices, vertices(scene)
    assert np.linalg.norm(np.ptp(now, axis=0)) > 0.9 * np.linalg.norm(np.ptp(rest, axis=0))


def test_a_soft_object_follows_keys_of_bones_while_they_play(scene):
    make_clip(scene)
    scene.posing.set_softness(0.8)
    scene.timeline.scrub(0)
    scene.timeline.play()
    for _ in range(15):
        scene.clock.advance(TIME_STEP)
    assert scene.timeline.playing and scene.posing.drives and not scene.clock.paused
    wanted = skinning_matrices(scene.rigging.skeleton, scene.timeline.bones_at(15))
    wanted = scene.rigging.bound().pose(wanted).numpy()
    driven = scene.grip.bones
    np.testing.assert_allclose(vertices(scene)[driven], wanted[driven], atol=1e-5)


def test_keys_of_a_skeleton_that_has_changed_are_of_vertices_alone(scene):
    make_clip(scene)
    with pytest.raises(ValueError, match="two keys or more"):
        scene.rigging.add_joint(np.array([0.6, 0.5, 0.5]))
        scene.rigging.save_clip("again")


def test_undo_takes_back_joints_poses_and_clips_to_the_bit(scene):
    first = vertices(scene)
    turn(scene)
    bent = vertices(scene)
    scene.posing.rest_bones([1])
    scene.undo()
    np.testing.assert_array_equal(vertices(scene), bent)
    scene.undo()
    np.testing.assert_array_equal(vertices(scene), first)
    for bones in (1, 0, 0):
        scene.undo()
        assert scene.rigging.bone_count == bones
    assert scene.rigging.loose is None and not scene.rigging.joints
    for _ in range(5):
        scene.redo()
    np.testing.assert_allclose(vertices(scene), scene.field.mesh.rest_vertices, atol=1e-6)
    scene.undo()
    np.testing.assert_array_equal(vertices(scene), bent)


def test_a_rig_of_the_model_is_there_from_the_start(scene, ball):
    make_clip(scene)
    arrays = rig.arrays_of(scene.rigging.rig)
    other = Scene(replace(ball, rig_arrays=arrays), "ball", "cpu")
    other.posing.scrub_clip("bend", 0.5)
    scene.posing.scrub_clip("bend", 0.5)
    np.testing.assert_allclose(vertices(other), vertices(scene), atol=1e-5)
    arrays["rig_parents"] = arrays["rig_parents"][:1]
    with pytest.raises(ValueError, match=r"the rig in the model ball can't be used: .*rig_parents"):
        Scene(replace(ball, rig_arrays=arrays), "ball", "cpu")


def test_offsets_of_a_model_pose_it_until_its_bones_are_others(scene, ball):
    made = scene.rigging.rig
    away = np.float32([0.02, 0.0, 0.01]) * made.weights.prod(axis=1)[:, None]
    offsets = np.stack([away, -away], axis=1)
    arrays = rig.arrays_of(rig.Rig(made.skeleton, made.weights, offsets=offsets))
    scene = Scene(replace(ball, rig_arrays=arrays), "ball", "cpu")
    turn(scene)
    matrices = skinning_matrices(scene.rigging.skeleton, scene.posing.pose)
    for method in rig.METHODS:
        scene.posing.set_skinning(method)
        rest = ball.mesh.rest_vertices
        wanted = rig.skinned(rest, made.weights, matrices, method, offsets)
        np.testing.assert_allclose(vertices(scene), wanted, atol=1e-5)
    np.testing.assert_array_equal(scene.rigging.rig.offsets, offsets)
    scene.rigging.move_joint(1, "tail", [0.6, 0.5, 0.9])
    assert scene.rigging.rig.offsets is None
    scene.undo()
    np.testing.assert_array_equal(scene.rigging.rig.offsets, offsets)


def test_what_is_deleted_is_let_go_of_and_the_rest_keeps_its_rig(scene, ball):
    scene.posing.set_softness(0.5)
    turn(scene)
    assert len(scene.grip.bones)
    before = vertices(scene)
    middles = ball.mesh.rest_vertices[ball.mesh.tets].mean(axis=1)
    gone = np.where(middles[:, 2] > 0.7, np.uint64(2**64 - 1), np.uint64(0))
    assert scene.cuts.delete(gone)
    assert not scene.posing.drives and not len(scene.grip.bones)
    smaller = scene.cuts.smaller(None, rig.arrays_of(scene.rigging.rig))
    count = smaller.mesh.vertex_count
    assert count < ball.mesh.vertex_count
    assert rig.rig_from(smaller.rig_arrays, count).skeleton.names == ("bone 1", "bone 2")
    scene.undo()
    assert scene.posing.drives and len(scene.grip.bones)
    np.testing.assert_array_equal(vertices(scene), before)
    turn(scene, 1, (0.2, 0.0, 0.0))
    scene.clock.advance(TIME_STEP)
