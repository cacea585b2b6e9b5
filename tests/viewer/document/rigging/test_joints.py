"""Joints as a hand places, moves and deletes them."""

import numpy as np
import pytest

from deformrf.viewer.document import HEAD, LOOSE, TAIL
from deformrf.viewer.document.rigging import joints


@pytest.fixture
def places():
    return np.random.default_rng().normal(size=(5, 3))


@pytest.fixture
def tree(places):
    """A chain of two bones, from whose middle joint a third one goes."""
    a, b, c, d, _ = places
    skeleton = joints.with_bone(None, -1, a, b)
    skeleton = joints.with_bone(skeleton, 0, b, c)
    return joints.with_bone(skeleton, 0, b, d)


def test_bones_begin_and_end_at_the_joints_that_were_placed(tree, places):
    a, b, c, d, _ = places
    np.testing.assert_array_equal(tree.heads, [a, b, b])
    np.testing.assert_array_equal(tree.tails, [b, c, d])
    assert tree.parents.tolist() == [-1, 0, 0]
    assert tree.names == ("bone 1", "bone 2", "bone 3")


def test_a_joint_is_named_once_however_many_bones_meet_there(tree, places):
    found = {joint.name: joint.place for joint in joints.joints_of(tree, places[4])}
    assert set(found) == {(0, TAIL), (0, HEAD), (1, TAIL), (2, TAIL), (LOOSE, HEAD)}
    np.testing.assert_array_equal(found[0, TAIL], places[1])
    np.testing.assert_array_equal(found[LOOSE, HEAD], places[4])


def test_a_joint_takes_along_all_bones_that_meet_there(tree, places):
    a, _, c, d, e = places
    moved = joints.moved(tree, 0, TAIL, e)
    np.testing.assert_array_equal(moved.heads, [a, e, e])
    np.testing.assert_array_equal(moved.tails, [e, c, d])
    along = moved.rest[1, :3, 1]  # the bone's own y-axis
    assert along == pytest.approx((c - e) / np.linalg.norm(c - e))


def test_what_hung_on_a_deleted_joint_hangs_on_the_joint_before(tree, places):
    a, _, c, d, _ = places
    left = joints.without_joint(tree, 0, TAIL)
    np.testing.assert_array_equal(left.heads, [a, a])
    np.testing.assert_array_equal(left.tails, [c, d])
    assert left.parents.tolist() == [-1, -1]
    assert left.names == ("bone 2", "bone 3")


def test_without_its_first_joint_a_chain_begins_at_the_second(tree, places):
    left = joints.without_joint(tree, 0, HEAD)
    np.testing.assert_array_equal(left.heads, [places[1], places[1]])
    assert left.parents.tolist() == [-1, -1]


def test_without_its_last_bone_there_is_no_skeleton(places):
    one = joints.with_bone(None, -1, *places[:2])
    assert joints.without_joint(one, 0, TAIL) is None


def test_a_free_name_is_taken(tree, places):
    left = joints.without_joint(tree, 1, TAIL)
    assert joints.with_bone(left, 0, *places[:2]).names == ("bone 1", "bone 3", "bone 2")


def test_a_bone_on_none_that_exists_is_refused(tree, places):
    with pytest.raises(ValueError, match="there is no bone 3"):
        joints.with_bone(tree, 3, *places[:2])
