"""Joints and bones under the mouse."""

import numpy as np
import pytest

from deformrf.core.render import Renderer
from deformrf.viewer.camera import picking
from deformrf.viewer.document import Scene
from deformrf.viewer.tools import TURN


@pytest.fixture
def scene(ball):
    made = Scene(ball, "ball", "cpu")
    made.settings.tool = "joints"
    return made


@pytest.fixture
def controls(scene, hand):
    """A hand on the ball, which sees it as it was at first."""
    made = hand(scene, lambda: depth)
    depth = Renderer(scene.field).render(made.camera).depth.numpy()
    return made


def pixel_of(controls, place):
    (at,), _ = picking.project(controls.camera, np.asarray(place, float)[None])
    return at


def drag(controls, start, way, steps=4):
    """The mouse goes on in steps, and time passes."""
    controls.press(start, "left")
    for k in range(1, steps + 1):
        controls.drag(start + np.multiply(way, k / steps), *np.divide(way, steps))
        controls.scene.clock.advance(1 / 60)


@pytest.fixture
def chain(controls, scene):
    """Two bones along the ball's axis, made by three clicks; then bones can be posed."""
    for height in (0.2, 0.5, 0.8):
        controls.click(pixel_of(controls, [0.5, 0.5, height]))
    scene.settings.tool = "bones"
    return scene.rigging


def test_a_click_puts_a_joint_into_the_middle_of_the_object(controls, chain):
    assert chain.skeleton.parents.tolist() == [-1, 0]
    forward = controls.camera.forward
    places = [chain.skeleton.heads[0], *chain.skeleton.tails]
    for place, height in zip(places, (0.2, 0.5, 0.8), strict=True):
        wanted = np.array([0.5, 0.5, height])
        assert pixel_of(controls, place) == pytest.approx(pixel_of(controls, wanted), abs=0.6)
        assert abs((place - wanted) @ forward) < 0.12


def test_a_click_on_a_joint_makes_it_the_one_to_go_on_from(controls, scene, chain):
    scene.settings.tool = "joints"
    controls.click(pixel_of(controls, chain.skeleton.tails[0]))
    assert chain.selected == (0, "tail") and chain.bone_count == 2
    controls.click(pixel_of(controls, [0.5, 0.5, 0.5]) + np.array([40.0, 0.0]))
    assert chain.skeleton.parents.tolist() == [-1, 0, 0]
    np.testing.assert_array_equal(chain.skeleton.heads[2], chain.skeleton.tails[0])


def test_a_click_beside_the_object_begins_another_chain(controls, scene, chain):
    scene.settings.tool = "joints"
    controls.click(np.array([5.0, 5.0]))
    assert chain.selected is None
    controls.click(pixel_of(controls, [0.5, 0.5, 0.65]) + np.array([20.0, 0.0]))
    assert chain.loose is not None and chain.bone_count == 2


def test_a_drag_of_a_joint_moves_it_and_a_drag_beside_joints_orbits(controls, scene, chain):
    scene.settings.tool = "joints"
    start = pixel_of(controls, chain.skeleton.tails[1])
    drag(controls, start, [20.0, 10.0])
    controls.release("left")
    assert pixel_of(controls, chain.skeleton.tails[1]) == pytest.approx(
        np.add(start, [20, 10]), abs=0.1
    )
    yaw, count = scene.orbit.yaw, chain.bone_count
    drag(controls, np.array([100.0, 120.0]), [30.0, 0.0])
    controls.release("left")
    assert scene.orbit.yaw != yaw and chain.bone_count == count


@pytest.mark.parametrize(("tool", "other"), [("joints", "bones"), ("bones", "joints")])
def test_a_drag_goes_on_as_it_began_if_a_key_changes_the_tool(controls, scene, chain, tool, other):
    scene.settings.tool = tool
    start, joint = pixel_of(controls, chain.skeleton.tails[1]), chain.skeleton.tails[1].copy()
    drag(controls, start, [20.0, 10.0])
    scene.settings.tool = other
    controls.drag(np.add(start, [30.0, 15.0]), 10.0, 5.0)
    controls.release("left")
    moves = tool == "joints"
    assert np.array_equal(chain.skeleton.tails[1], joint) is not moves
    assert scene.posing.drives is not moves
    if moves:
        at = pixel_of(controls, chain.skeleton.tails[1])
        assert at == pytest.approx(np.add(start, [30.0, 15.0]), abs=0.1)


def test_delete_takes_the_chosen_joint(controls, scene, chain):
    assert controls.bones.delete()
    assert chain.bone_count == 1 and chain.selected is None
    assert not controls.bones.delete()
    scene.undo()
    assert chain.bone_count == 2


def test_a_joint_on_a_bent_object_puts_it_to_rest_first(controls, scene, chain):
    scene.settings.tool = "joints"
    scene.posing.hold_bone(1)
    start = pixel_of(controls, chain.skeleton.tails[1])
    scene.settings.tool = "bones"
    drag(controls, start, [40.0, 0.0])
    controls.release("left")
    assert abs(scene.positions - scene.field.mesh.rest_vertices).max() > 0.02
    scene.settings.tool = "joints"
    controls.click(pixel_of(controls, [0.5, 0.5, 0.65]) + np.array([20.0, 0.0]))
    assert chain.bone_count == 2
    assert abs(scene.positions - scene.field.mesh.rest_vertices).max() < 1e-6


def test_the_tip_that_is_dragged_stays_under_the_mouse(controls, scene, chain):
    start = np.add(pixel_of(controls, chain.skeleton.tails[1]), [1.0, 2.0])
    drag(controls, start, [-30.0, 40.0])
    tip = pixel_of(controls, scene.posing.ends[1, 1])
    assert tip == pytest.approx(np.add(start, [-31.0, 38.0]), abs=0.1)
    np.testing.assert_allclose(scene.posing.ends[0, 0], chain.skeleton.heads[0], atol=1e-9)
    controls.release("left")
    assert scene.journal.undoes == "pose a bone"
    scene.undo()
    assert scene.posing.pose is None


def test_a_bone_turns_about_its_head_by_the_angle_of_the_mouse(controls, scene, chain):
    head, middle = (pixel_of(controls, p) for p in ([0.5, 0.5, 0.5], [0.5, 0.5, 0.66]))
    drag(controls, middle, [25.0, 25.0], steps=8)
    controls.release("left")
    head, tail = (pixel_of(controls, place) for place in scene.posing.ends[1])
    goal = np.add(middle, [25.0, 25.0])
    wanted, found = (np.arctan2(*(at - head)[::-1]) for at in (goal, tail))
    assert found == pytest.approx(wanted, abs=0.08)  # the eye is near: angles look wider
    np.testing.assert_allclose(scene.posing.ends[0], [*_ends(chain, 0)], atol=1e-9)


def _ends(rigging, bone):
    return rigging.skeleton.heads[bone], rigging.skeleton.tails[bone]


def test_x_turns_about_x_alone_and_e_goes_from_reaching_to_turning(controls, scene, chain):
    start = pixel_of(controls, chain.skeleton.tails[1])
    drag(controls, start, [5.0, 0.0])
    controls.turn_into(TURN)
    controls.along(0)
    before = scene.posing.ends[1].copy()
    controls.drag(np.add(start, [40.0, 20.0]), 35, 20)
    scene.clock.advance(1 / 60)
    way = scene.posing.ends[1] - before
    assert np.linalg.norm(way[1]) > 0.02
    assert way[:, 0] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_esc_takes_the_pose_of_the_drag_back(controls, scene, chain):
    vertices = scene.solver.vertices.numpy().copy()
    drag(controls, pixel_of(controls, chain.skeleton.tails[1]), [-30.0, 40.0])
    assert scene.posing.drives
    controls.cancel()
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), vertices)
    assert not scene.posing.drives and not controls.mode and scene.settings.tool == "bones"


def test_hidden_bones_are_not_taken(controls, scene, chain):
    scene.settings.show_bones = False
    drag(controls, pixel_of(controls, chain.skeleton.tails[1]), [-30.0, 40.0])
    assert controls.mode == "orbit" and not scene.posing.drives
