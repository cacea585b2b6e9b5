"""Bones: frames, poses, turning and reaching, and skeletons that are none."""

import numpy as np
import pytest

from deformrf.wings.rig import (
    BonePose,
    Skeleton,
    make_skeleton,
    mixed,
    pose_of,
    posed,
    reach,
    rotations,
    turned,
)
from deformrf.wings.rig.skeleton import parents_first, posed_tails, skinning_matrices

NAMES, PARENTS = ("root", "arm", "hand", "other"), (-1, 0, 1, 0)
HEADS = [[0, 0, 0], [0, 0, 1], [0.2, 0, 2], [1, 0, 0]]
TAILS = [[0, 0, 1], [0.2, 0, 2], [0, 0, 2.8], [1, 1, 0]]


@pytest.fixture
def skeleton():
    return make_skeleton(NAMES, PARENTS, HEADS, TAILS)


def random_pose(skeleton, scale=0.0):
    rng = np.random.default_rng()
    count = skeleton.bone_count
    return BonePose(
        rng.normal(size=(count, 3)),
        rotations.unit(rng.normal(size=(count, 4))),
        1.0 + scale * rng.uniform(-1.0, 1.0, (count, 3)),
    )


def test_quaternions_are_rotation_matrices():
    rng = np.random.default_rng()
    a, b = rotations.unit(rng.normal(size=(2, 50, 4)))
    matrices = rotations.matrix_of(a)
    np.testing.assert_allclose(
        matrices @ np.swapaxes(matrices, 1, 2), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(
        rotations.matrix_of(rotations.product(a, b)), matrices @ rotations.matrix_of(b), atol=1e-12
    )
    np.testing.assert_allclose(
        rotations.matrix_of(rotations.quaternion_of(matrices)), matrices, atol=1e-12
    )
    x = rng.normal(size=(50, 3))
    np.testing.assert_allclose(
        rotations.rotated(a, x), np.einsum("nij,nj->ni", matrices, x), atol=1e-12
    )


def test_half_turns_are_found_in_matrices():
    halves = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0.6, 0.8, 0, 0]])
    found = rotations.quaternion_of(rotations.matrix_of(halves))
    np.testing.assert_allclose(np.abs(np.sum(found * halves, axis=1)), 1.0)


def test_slerp_has_constant_speed_and_goes_the_shorter_way():
    end = rotations.of_vector([0.0, 0.0, 1.2])
    for sign in (1.0, -1.0):
        third = rotations.slerp(rotations.IDENTITY, sign * end, 1.0 / 3.0)
        np.testing.assert_allclose(np.abs(third @ rotations.of_vector([0.0, 0.0, 0.4])), 1.0)


def test_between_turns_one_direction_to_the_other():
    rng = np.random.default_rng()
    a, b = rng.normal(size=(2, 20, 3))
    b[0] = -a[0]
    turned_a = rotations.rotated(rotations.between(a, b), a)
    directions = [v / np.linalg.norm(v, axis=1, keepdims=True) for v in (turned_a, b)]
    np.testing.assert_allclose(*directions, atol=1e-12)


def test_the_rest_pose_moves_nothing(skeleton):
    matrices = skinning_matrices(skeleton, skeleton.rest_pose)
    np.testing.assert_allclose(matrices, np.tile(np.eye(4), (4, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(posed_tails(skeleton, skeleton.rest_pose), TAILS, atol=1e-12)


def test_bones_point_along_their_y_axis(skeleton):
    along = np.subtract(TAILS, HEADS)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    np.testing.assert_allclose(skeleton.rest[:, :3, 1], along, atol=1e-12)


def test_a_pose_is_found_in_its_frames(skeleton):
    pose = random_pose(skeleton)
    frames = posed(skeleton, pose)
    np.testing.assert_allclose(posed(skeleton, pose_of(skeleton, frames)), frames, atol=1e-9)


def test_mixing_poses_ends_at_each(skeleton):
    a, b = random_pose(skeleton), random_pose(skeleton)
    for share, wanted in ((0.0, a), (1.0, b)):
        frames = posed(skeleton, mixed(a, b, share))
        np.testing.assert_allclose(frames, posed(skeleton, wanted), atol=1e-9)


def test_a_bone_turns_about_its_head_in_model_space(skeleton):
    pose, vector = random_pose(skeleton), np.array([0.3, -0.5, 0.2])
    before = posed(skeleton, pose)
    after = posed(skeleton, turned(skeleton, pose, 1, vector))
    turn = rotations.matrix_of(rotations.of_vector(vector))
    np.testing.assert_allclose(after[[0, 3]], before[[0, 3]], atol=1e-12)
    np.testing.assert_allclose(after[1, :3, 3], before[1, :3, 3], atol=1e-12)
    for bone in (1, 2):
        np.testing.assert_allclose(after[bone, :3, :3], turn @ before[bone, :3, :3], atol=1e-9)


@pytest.mark.parametrize("target", [(0.5, 0.3, 1.9), (-0.4, 0.2, 1.6), (0.9, -0.9, 1.2)])
def test_two_bones_reach_a_point(skeleton, target):
    pose = reach(skeleton, skeleton.rest_pose, 2, target)
    np.testing.assert_allclose(posed_tails(skeleton, pose)[2], target, atol=1e-6)
    heads = posed(skeleton, pose)[:, :3, 3]
    np.testing.assert_allclose(heads[1], HEADS[1], atol=1e-9)  # the limb hangs where it did
    length = np.linalg.norm(np.subtract(HEADS[2], HEADS[1]))
    np.testing.assert_allclose(np.linalg.norm(heads[2] - heads[1]), length)


def test_a_limb_stretches_towards_what_is_too_far(skeleton):
    target = np.array([5.0, 0.0, 1.0])
    pose = reach(skeleton, skeleton.rest_pose, 2, target)
    tail = posed_tails(skeleton, pose)[2]
    np.testing.assert_allclose(tail[1:], target[1:], atol=1e-3)
    lengths = [
        np.linalg.norm(np.subtract(a, b)) for a, b in ((HEADS[1], HEADS[2]), (HEADS[2], TAILS[2]))
    ]
    np.testing.assert_allclose(tail[0], sum(lengths), atol=1e-6)


def test_a_straight_limb_bends(skeleton):
    straight = make_skeleton(("a", "b"), (-1, 0), [[0, 0, 0], [0, 0, 1]], [[0, 0, 1], [0, 0, 2]])
    pose = reach(straight, straight.rest_pose, 1, (0.0, 0.0, 1.2))
    np.testing.assert_allclose(posed_tails(straight, pose)[1], (0.0, 0.0, 1.2), atol=1e-6)


def test_a_root_aims_alone(skeleton):
    pose = reach(skeleton, skeleton.rest_pose, 0, (3.0, 0.0, 0.0))
    np.testing.assert_allclose(posed_tails(skeleton, pose)[0], (1.0, 0.0, 0.0), atol=1e-9)


def test_parents_come_first():
    order = parents_first(("c", "a", "b"), (2, -1, 1))
    assert order == [1, 2, 0]


@pytest.mark.parametrize(
    "parents, sentence",
    [((1, 2, 0), "its own ancestor"), ((-1, 7, 0), "does not exist"), ((0, 0, 0), "own ancestor")],
)
def test_cycles_and_missing_bones_are_found(parents, sentence):
    with pytest.raises(ValueError, match=sentence):
        parents_first(("a", "b", "c"), parents)


def broken(name, value):
    skeleton = make_skeleton(NAMES, PARENTS, HEADS, TAILS)
    parts = {k: np.array(getattr(skeleton, k)) for k in ("parents", "rest", "tails")}
    parts["names"] = skeleton.names
    parts[name] = value(parts[name])
    return parts


def set_to(index, value):
    def change(array):
        array[index] = value
        return array

    return change


@pytest.mark.parametrize(
    "name, value, sentence",
    [
        ("parents", set_to(2, 3), "the parent of bone 'hand' is number 3"),
        ("parents", set_to(0, 0), "no bone may be its own ancestor"),
        ("rest", set_to((1, 0, 3), np.nan), "the rest frame of bone 'arm' holds NaN"),
        ("rest", set_to((1, 0, 0), 3.0), "the rest frame of bone 'arm' is no rotation"),
        ("rest", lambda rest: rest[:2], "the skeleton's rest are"),
        ("tails", set_to((3, 0), np.inf), "the tail of bone 'other' holds NaN"),
        ("names", lambda names: ("a", "a", "b", "c"), "two bones have the name 'a'"),
        ("names", lambda names: ("", "a", "b", "c"), "1 to 100 printable characters"),
        ("names", lambda names: (), "0 bones"),
    ],
)
def test_bad_skeletons_end_in_one_sentence(name, value, sentence):
    with pytest.raises(ValueError, match=sentence):
        Skeleton(**broken(name, value))
