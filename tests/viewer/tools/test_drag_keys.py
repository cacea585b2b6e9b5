"""Drags of the gizmo, drags without a button, and numbers that are typed."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.deform import TIME_STEP
from deformrf.viewer.camera import project
from deformrf.viewer.document import (
    Player,
    Scene,
    load_session,
    rotation_matrix,
    save_session,
    start_of,
)
from deformrf.viewer.tools import keys as inputs

KINDS = "move", "turn", "scale"


@pytest.fixture
def scene(ball):
    made = Scene(ball, "ball", "cpu")
    made.settings.grab_radius = 0.0
    return made


@pytest.fixture
def controls(scene, hand):
    made = hand(scene)
    made.size = 320, 240
    return made


def select(controls, count=3):
    """Some points to the eye's side."""
    scene = controls.scene
    _, t = project(controls.camera, scene.handles.at(scene.handles.control_ids))
    ids = [int(one) for one in scene.handles.control_ids[np.argsort(t)[:count]]]
    scene.handles.select(ids)
    return ids


def part_named(controls, name):
    return next(part for part in controls.gizmo_parts() if part.name == name)


def free_pixel(controls, part):
    """A pixel of a part where nothing else is."""
    shares = np.linspace(0.3, 1.0, 20)
    ends = part.line[0] + shares[:, None] * (part.line[-1] - part.line[0])
    pixels = [*part.line[len(part.line) // 2 :], *ends, *part.line]
    if part.across:
        pixels = [part.grip, *(0.5 * (part.grip + part.line))]
    return next(p for p in pixels if getattr(controls.gizmo_part_at(p), "name", "") == part.name)


def drag_part(controls, name, way, steps=3):
    """Press on a part of the gizmo, and go on in steps while time passes."""
    start = free_pixel(controls, part_named(controls, name))
    controls.press(start, "left")
    assert controls.mode == "gizmo" and controls.scene.handles.grabbed is None
    for k in range(1, steps + 1):
        controls.drag(start + np.multiply(way, k / steps), *np.divide(way, steps))
        controls.scene.clock.advance(TIME_STEP)
    return start


def type_in(controls, text):
    for character in text:
        controls.on_text(character)


def played(scene, ball, start, folder):
    """The scene of the session, played again."""
    session = load_session(save_session(scene, start, folder / "s.jsonl"), ball)
    other = Scene(ball, "ball", "cpu")
    Player(other, session).play_to(session.ticks)
    return other


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("name", ["x", "z", "xy", "xz"])
def test_an_arrow_moves_along_its_axis_and_a_square_in_its_plane(controls, scene, name, own):
    scene.orbit = replace(scene.orbit, yaw=0.6, pitch=0.5)
    scene.settings.own_axes = own
    ids = select(controls)
    if own:
        turn = rotation_matrix(np.array([0.3, -0.2, 0.4]))
        scene.solver.set_state(((scene.positions - 0.5) @ turn.T + 0.5).astype(np.float32))
        scene.revision += 1
    before, vertices = scene.handles.at(ids), scene.solver.vertices.numpy().copy()
    axes = turn if own else np.eye(3)
    drag_part(controls, name, [14.0, -12.0])
    moved = (scene.handles.grabbed.target.place - scene.handles.grabbed.start) @ axes
    others = [axis for axis in range(3) if "xyz"[axis] not in name]
    assert moved[others] == pytest.approx(np.zeros(len(others)), abs=1e-5)
    assert np.linalg.norm(moved) > 0.01
    np.testing.assert_allclose(
        scene.handles.at(ids) - before, np.tile(axes @ moved, (3, 1)), atol=1e-5
    )
    controls.release("left")
    assert scene.handles.selected == ids and scene.journal.undoes == "drag"
    scene.undo()
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), vertices)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ending", ["escape", "right button"])
def test_it_can_be_cancelled(controls, scene, kind, ending):
    scene.settings.gizmo = kind
    select(controls)
    vertices = scene.solver.vertices.numpy().copy()
    drag_part(controls, "z", [9.0, -15.0])
    assert (scene.solver.vertices.numpy() != vertices).any()
    if ending == "escape":
        controls.cancel()
    else:
        controls.press(controls.at, "right")
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), vertices)
    assert (controls.mode, scene.handles.grabbed) == ("", None)
    assert [step.in_vain for step in scene.journal.steps] == [True]
    controls.drag(controls.at + 5.0, 5, 5)  # the button is still down
    controls.release("left")
    assert scene.handles.grabbed is None


def test_a_ring_turns_about_its_axis_and_a_box_stretches_along_it(controls, scene, ball, tmp_path):
    scene.orbit = replace(scene.orbit, yaw=0.6, pitch=0.6)
    start, ids = start_of(scene), select(controls, 4)
    before = scene.handles.at(ids)
    center = before.mean(axis=0)
    scene.settings.gizmo = "turn"
    drag_part(controls, "z", [45.0, 5.0])
    rotation = scene.handles.grabbed.reached.rotation
    assert rotation[:2] == pytest.approx([0.0, 0.0], abs=1e-9) and abs(rotation[2]) > 0.1
    turned = (before - center) @ rotation_matrix(rotation).T + center
    np.testing.assert_allclose(scene.handles.at(ids), turned, atol=1e-5)
    controls.release("left")
    scene.reset()
    scene.settings.gizmo = "scale"
    drag_part(controls, "x", [20.0, -4.0])
    factor = controls.held_drag.amount
    assert abs(factor - 1.0) > 0.05
    stretched = center + (before - center) * [factor, 1.0, 1.0]
    np.testing.assert_allclose(scene.handles.at(ids), stretched, atol=1e-5)
    controls.release("left")
    assert "stretch" in {event.name for event in scene.journal.events}
    other = played(scene, ball, start, tmp_path)
    np.testing.assert_array_equal(other.solver.vertices.numpy(), scene.solver.vertices.numpy())
    assert other.journal.events == scene.journal.events


def test_a_click_goes_through_the_gizmo(controls, scene):
    ids = select(controls)
    controls.click(free_pixel(controls, part_named(controls, "z")))
    assert scene.handles.selected == [] != ids


def test_alt_orbits_also_on_the_gizmo(controls, scene):
    select(controls)
    pixel = free_pixel(controls, part_named(controls, "z"))
    controls.press(pixel, "left", inputs.ALT)
    assert controls.mode == "orbit"
    controls.release("left")


def test_a_red_point_comes_before_the_gizmo(controls, scene):
    (handle,) = select(controls, 1)
    assert controls.gizmo_part_at(controls.pixel_of(handle)) is None
    controls.motion(free_pixel(controls, part_named(controls, "x")))
    assert controls.part.name == "x" and scene.handles.hover is None


# -- without a button --------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["click", "enter", "right button", "escape"])
def test_a_free_drag_goes_with_the_mouse_until_it_ends(controls, scene, ending):
    ids = select(controls)
    scene.settings.hand = "pose"
    before, vertices = scene.handles.at(ids), scene.solver.vertices.numpy().copy()
    controls.motion((100.0, 100.0))
    controls.turn_into("move")
    assert controls.free and scene.handles.grabbed.handles == ids
    np.testing.assert_array_equal(scene.handles.grabbed.target.place, before[0])  # no jump
    controls.motion((120.0, 90.0))
    scene.clock.advance(TIME_STEP)
    pixels, _ = project(controls.camera, np.stack([scene.handles.at(ids), before]).mean(axis=1))
    assert pixels[0] - pixels[1] == pytest.approx([20.0, -10.0], abs=0.5)
    if ending == "click":
        controls.click((120.0, 90.0))
    elif ending == "enter":
        controls.finish()
    elif ending == "escape":
        controls.cancel()
    else:
        controls.press((120.0, 90.0), "right")
    assert (controls.free, controls.mode, scene.handles.grabbed) == (False, "", None)
    if ending in ("click", "enter"):
        assert set(scene.handles.posed) == set(ids) and scene.handles.selected == ids
        scene.undo()
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), vertices)


def test_without_a_selection_it_takes_the_point_under_the_mouse_or_says_so(controls, scene):
    said = []
    controls.say = said.append
    controls.turn_into("turn")
    assert not controls.free and said[-1].startswith("nothing to turn")
    (handle,) = select(controls, 1)
    scene.handles.select([])
    controls.motion(controls.pixel_of(handle))
    controls.turn_into("move")
    assert controls.free and scene.handles.grabbed.handles == [handle]


def test_a_number_says_how_far_and_the_mouse_no_longer(controls, scene):
    ids = select(controls)
    before = scene.handles.at(ids)
    controls.turn_into("move")
    controls.along(2)
    type_in(controls, "0.1x5")
    controls.motion((10.0, 10.0))
    scene.clock.advance(TIME_STEP)
    way = scene.handles.at(ids) - before
    np.testing.assert_allclose(way, np.tile([0.0, 0.0, 0.15 * scene.size], (3, 1)), atol=1e-5)
    assert controls.held_drag.line == "move along z: 0.15_ of the size"
    type_in(controls, "-")
    scene.clock.advance(TIME_STEP)
    assert (scene.handles.at(ids) - before)[0, 2] == pytest.approx(-0.15 * scene.size, abs=1e-5)
    controls.turn_into("turn")
    type_in(controls, "90")
    turn = scene.handles.grabbed.target.rotation
    np.testing.assert_allclose(turn, [0.0, 0.0, 0.5 * np.pi], atol=1e-9)
    controls.turn_into("scale")
    controls.along(2)
    controls.along(2)
    type_in(controls, "2")
    assert scene.handles.grabbed.target.scale == 2.0
    for text in ("\b", "0", "\b", "-1"):
        for character in text:
            controls.type(character)
        assert np.isfinite(scene.handles.grabbed.target.scale)
        assert scene.handles.grabbed.target.scale > 0.0
    controls.finish()


def test_x_twice_is_the_own_axis_and_shift_the_plane(controls, scene):
    select(controls, 2)
    turn = rotation_matrix(np.array([0.0, 0.5, 0.3]))
    scene.solver.set_state(((scene.positions - 0.5) @ turn.T + 0.5).astype(np.float32))
    scene.revision += 1
    controls.turn_into("move")
    start = scene.handles.grabbed.start
    for axis, across, directions in (
        (0, False, np.eye(3)[:, :1]),
        (0, False, turn[:, :1]),
        (0, True, np.eye(3)[:, 1:]),
        (0, True, turn[:, 1:]),
    ):
        controls.along(axis, across)
        controls.motion(np.random.default_rng().uniform(50.0, 200.0, 2))
        way = scene.handles.grabbed.target.place - start
        np.testing.assert_allclose(directions @ (directions.T @ way), way, atol=1e-5)


# -- bones and joints --------------------------------------------------------------------------


@pytest.fixture
def chain(scene):
    """Two bones along the ball's axis; the second one is chosen."""
    rigging = scene.rigging
    for height in (0.2, 0.5, 0.8):
        rigging.add_joint(np.array([0.5, 0.5, height]))
    return rigging


def test_a_ring_turns_the_chosen_bone_about_its_head(controls, scene, chain, ball, tmp_path):
    scene.settings.tool, scene.settings.gizmo = "bones", "turn"
    before = scene.posing.ends.copy()
    scene.orbit = replace(scene.orbit, yaw=0.4, pitch=0.3)
    drag_part(controls, "y", [40.0, 30.0])
    angle = np.radians(controls.held_drag.amount)
    assert abs(angle) > 0.05
    controls.release("left")
    arm = rotation_matrix(angle * np.eye(3)[1]) @ (before[1, 1] - before[1, 0])
    np.testing.assert_allclose(scene.posing.ends[1], [before[1, 0], before[1, 0] + arm], atol=1e-6)
    np.testing.assert_allclose(scene.posing.ends[0], before[0], atol=1e-9)
    scene.undo()
    np.testing.assert_array_equal(scene.posing.ends, before)


def test_a_bone_is_turned_by_a_number_and_reaches_with_its_tip(controls, scene, chain):
    scene.settings.tool = "bones"
    before = scene.posing.ends.copy()
    controls.turn_into("turn")
    controls.along(1)
    type_in(controls, "90")
    controls.finish()
    tail = before[1, 0] + [0.3, 0.0, 0.0]
    np.testing.assert_allclose(scene.posing.ends[1, 1], tail, atol=1e-6)
    controls.turn_into("move")
    controls.along(2)
    type_in(controls, "0.05")
    controls.finish()
    wanted = tail + np.array([0.0, 0.0, 0.05 * scene.size])
    np.testing.assert_allclose(scene.posing.ends[1, 1], wanted, atol=1e-5)
    said = []
    controls.say = said.append
    controls.turn_into("scale")
    assert said[-1] == "scale: not with a bone" and not controls.mode
    scene.settings.gizmo = "scale"  # it offers what can be done
    assert {part.name for part in controls.gizmo_parts()} == {"x", "y", "z", "view"}


@pytest.mark.parametrize("by", ["gizmo", "mouse", "number"])
def test_a_root_is_moved_with_all_that_hangs_on_it(controls, scene, chain, ball, tmp_path, by):
    scene.settings.tool, start = "bones", start_of(scene)
    before = scene.posing.ends.copy()
    vertices = scene.solver.vertices.numpy().copy()
    scene.rigging.selected = 0, "head"
    if by == "gizmo":
        drag_part(controls, "x", [20.0, 4.0])
        controls.release("left")
    elif by == "mouse":
        (head,), _ = project(controls.camera, before[:1, 0])
        controls.press(head, "left")
        controls.drag(head + np.array([20.0, 0.0]), 20, 0)
        scene.clock.advance(TIME_STEP)
        controls.release("left")
    else:
        controls.turn_into("move")
        controls.along(0)
        type_in(controls, "0.1")
        controls.finish()
    way = scene.posing.ends[0, 0] - before[0, 0]
    assert way[0] > 0.02
    np.testing.assert_allclose(scene.posing.ends, before + way, atol=1e-6)
    moved = scene.solver.vertices.numpy() - vertices
    np.testing.assert_allclose(moved, np.tile(way, (len(moved), 1)), atol=1e-5)
    other = played(scene, ball, start, tmp_path)
    np.testing.assert_array_equal(other.solver.vertices.numpy(), scene.solver.vertices.numpy())
    np.testing.assert_array_equal(other.posing.ends, scene.posing.ends)
    scene.undo()
    np.testing.assert_array_equal(scene.posing.ends, before)
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), vertices)


@pytest.mark.parametrize("ending", ["click", "escape"])
def test_a_joint_is_moved_along_an_arrow_or_goes_back(controls, scene, chain, ending):
    scene.settings.tool = "joints"
    scene.rigging.selected = 0, "tail"
    before = scene.posing.ends.copy()
    start = free_pixel(controls, part_named(controls, "x"))
    controls.press(start, "left")
    controls.drag(np.add(start, [15.0, 3.0]), 15, 3)
    way = controls.bones.place - before[0, 1]
    assert way[1:] == pytest.approx([0.0, 0.0], abs=1e-9) and way[0] > 0.01
    if ending == "escape":
        controls.cancel()
        way = np.zeros(3)
    controls.release("left")
    np.testing.assert_allclose(chain.skeleton.tails[0], before[0, 1] + way)
    np.testing.assert_allclose(chain.skeleton.heads[1], before[0, 1] + way)


def test_a_joint_that_is_deleted_while_it_is_dragged_is_let_go(controls, scene, chain):
    from types import SimpleNamespace

    from deformrf.viewer.actions import ACTIONS

    scene.settings.tool = "joints"
    controls.turn_into("move")
    assert controls.mode == "bone"
    like = {"scene": scene, "controls": controls, "strip": None}
    ACTIONS["delete_key"](SimpleNamespace(**like, recorder=SimpleNamespace(say=print)))
    assert not controls.mode and chain.bone_count == 1
    controls.motion((50.0, 50.0))


# -- the mouse with Blender's keys -------------------------------------------------------------


@pytest.mark.parametrize(
    "keys, modifiers, turns",
    [("deformrf", 0, False), ("blender", 0, True), ("blender", inputs.SHIFT, False)],
)
def test_the_middle_button_orbits_with_blenders_keys(controls, scene, keys, modifiers, turns):
    scene.settings.keys, before = keys, scene.orbit
    select(controls)
    controls.press((160.0, 120.0), "middle", modifiers)
    controls.drag(np.array([180.0, 130.0]), 20, 10)
    controls.release("middle", modifiers)
    assert (scene.orbit.yaw != before.yaw) == turns
    assert (scene.orbit.target != before.target).any() != turns
    controls.press((160.0, 120.0), "middle", modifiers)
    controls.release("middle", modifiers)
    assert scene.handles.selected  # only a click of the left button lets it go


@pytest.mark.parametrize("text", ["", "nan", "1e400", "-inf", "a third", "9" * 400])
def test_what_is_no_number_is_refused_with_a_sentence(controls, scene, text):
    said = []
    controls.say = said.append
    select(controls)
    controls.apply(text, 0)
    assert said[-1].endswith("is no number") and len(said[-1]) < 40
    assert not controls.mode and scene.journal.steps == []


@pytest.mark.parametrize("own", [False, True])
def test_a_number_of_the_panel_is_applied_at_once_as_one_step(controls, scene, own):
    scene.settings.hand, scene.settings.own_axes = "pose", own
    ids = select(controls)
    before = scene.handles.at(ids)
    controls.apply(" 0.1 ", 2)
    scene.clock.advance(TIME_STEP)
    controls.end_if_there()
    assert not controls.mode and set(scene.handles.posed) == set(ids)
    way = np.tile([0.0, 0.0, 0.1 * scene.size], (3, 1))
    np.testing.assert_allclose(scene.handles.at(ids) - before, way, atol=1e-5)
    assert [step.label for step in scene.journal.steps] == ["drag"]
    controls.apply("1e300", 0)  # as far as a drag goes
    scene.clock.advance(TIME_STEP)
    assert np.isfinite(scene.handles.at(ids)).all()
    controls.cancel()
    assert not controls.finishes


def test_a_number_of_the_panel_turns_a_bone_and_moves_a_joint(controls, scene, chain):
    scene.settings.tool, scene.settings.gizmo = "bones", "turn"
    before = scene.posing.ends.copy()
    controls.apply("-90", 1)
    controls.end_if_there()
    np.testing.assert_allclose(scene.posing.ends[1, 1], before[1, 0] - [0.3, 0, 0], atol=1e-6)
    scene.undo()
    scene.settings.tool = "joints"
    controls.apply("0.05", 0)
    controls.end_if_there()
    moved = before[1, 1] + np.array([0.05 * scene.size, 0.0, 0.0])
    np.testing.assert_allclose(scene.rigging.skeleton.tails[1], moved)


def look_away(scene):
    """The camera has the object behind it."""
    away = scene.orbit.target - 6.0 * scene.orbit.pose[:3, 2]
    scene.orbit = replace(scene.orbit, target=away)


@pytest.mark.parametrize("tool", ["grab", "bones", "joints"])
@pytest.mark.parametrize("kind", ["move", "turn"])
def test_what_is_behind_the_eye_is_not_dragged(controls, scene, chain, tool, kind):
    said, scene.settings.tool = [], tool
    controls.say = said.append
    if tool == "grab":
        select(controls)
    look_away(scene)
    controls.turn_into(kind)
    assert not controls.mode and not controls.free
    assert "behind the eye" in said[-1] or (tool, kind) == ("joints", "turn")


@pytest.mark.parametrize("tool", ["grab", "bones", "joints"])
def test_what_comes_behind_the_eye_in_a_drag_stays_finite(controls, scene, chain, tool):
    scene.settings.tool = tool
    if tool == "grab":
        select(controls)
    controls.turn_into("move")
    assert controls.free
    look_away(scene)
    for way in (30.0, -50.0):
        controls.on_mouse_motion(int(150 + way), 100, int(way), 0)
        scene.clock.advance(TIME_STEP)
    controls.finish()
    assert not controls.mode and np.isfinite(scene.positions).all()


def test_the_panel_refuses_a_factor_that_is_not_positive(controls, scene):
    said, scene.settings.gizmo = [], "scale"
    controls.say = said.append
    select(controls)
    for text in ("0", "-2"):
        controls.apply(text, 0)
        assert said[-1] == "a factor is more than 0" and not controls.free
