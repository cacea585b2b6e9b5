"""Selections, and drags that move, turn or scale them."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.deform import TIME_STEP
from deformrf.viewer.camera import picking
from deformrf.viewer.document import Motion, Scene, rotation_matrix, rotation_vector
from deformrf.viewer.settings import GRAB_RADII
from deformrf.viewer.tools import CTRL, SHIFT, drags

SIZE = 320, 240


@pytest.fixture
def scene(ball):
    made = Scene(ball, "ball", "cpu")
    made.settings.grab_radius = 0.0
    return made


@pytest.fixture
def controls(scene, hand):
    return hand(scene)


def pixel_of(controls, handle):
    return controls.pixel_of(handle)


def front_vertex(controls):
    return apart(controls, 1)[0]


def apart(controls, count=3):
    """Handles whose spheres don't cover each other.  [count]"""
    ids = controls.scene.handles.control_ids
    pixels, t = picking.project(controls.camera, controls.scene.handles.at(ids))
    chosen = []
    for k in np.argsort(t):
        if all(np.linalg.norm(pixels[k] - pixels[j]) > 25.0 for j in chosen):
            chosen.append(k)
    return [int(ids[k]) for k in chosen[:count]]


def test_clicks_select_and_modifiers_add_and_remove(controls, scene):
    a, b, far = apart(controls)
    controls.click(pixel_of(controls, a))
    assert scene.handles.selected == [a]
    controls.click(pixel_of(controls, b), SHIFT)
    assert scene.handles.selected == [a, b]
    controls.click(pixel_of(controls, a), CTRL)
    assert scene.handles.selected == [b]
    controls.click(pixel_of(controls, far), CTRL)
    assert scene.handles.selected == [b]
    controls.click(pixel_of(controls, b), SHIFT)
    assert scene.handles.selected == []
    controls.click(pixel_of(controls, a))
    controls.click((3.0, 3.0))
    assert scene.handles.selected == []
    assert scene.journal.cursor == 0  # a click bends nothing, and there is nothing to undo


def test_shift_may_be_let_go_before_the_button(controls, scene):
    a, b, _ = apart(controls)
    scene.handles.select([a, b])
    controls.press(pixel_of(controls, a), "left", SHIFT)
    controls.release("left")
    assert scene.handles.selected == [b]


def test_a_selection_is_dragged_as_one(controls, scene):
    a, b, _ = apart(controls)
    scene.handles.select([a, b])
    before = scene.handles.at([a, b])
    press = pixel_of(controls, a)
    controls.press(press, "left")
    controls.drag(press + np.array([20.0, 10.0]), 20, 10)
    scene.clock.advance(TIME_STEP)
    moved = scene.handles.at([a, b]) - before
    assert moved[0] == pytest.approx(moved[1], abs=1e-6) and np.linalg.norm(moved[0]) > 0.02
    controls.release("left")
    assert scene.handles.selected == [a, b]
    scene.undo()
    np.testing.assert_allclose(scene.handles.at([a, b]), before, atol=1e-6)


def test_a_drag_of_another_point_leaves_the_selection(controls, scene):
    a, b, other = apart(controls)
    scene.handles.select([a, b])
    press = pixel_of(controls, other)
    controls.press(press, "left")
    controls.drag(press + np.array([20.0, 0.0]), 20, 0)
    assert scene.handles.selected == [] and scene.handles.grabbed.handles == [other]


@pytest.mark.parametrize("tool", ["box", "lasso"])
def test_a_box_and_a_lasso_select_what_they_enclose(controls, scene, tool):
    ids = scene.handles.control_ids
    pixels, _ = picking.project(controls.camera, scene.handles.at(ids))
    low, high = np.array([60.0, 40.0]), np.array([180.0, 130.0])
    inside = {int(i) for i in ids[((pixels > low) & (pixels < high)).all(axis=1)]}
    assert 3 < len(inside) < len(ids)

    def draw(how):
        scene.settings.tool = tool
        controls.press(low, "left", how)
        corners = [high] if tool == "box" else [(high[0], low[1]), high, (low[0], high[1])]
        for corner in corners:
            controls.drag(np.array(corner), 1, 1)
        controls.release("left", how)
        assert scene.settings.tool == "grab"  # once
        return set(scene.handles.selected)

    assert draw(0) == inside
    some, others = sorted(inside)[0], next(int(i) for i in ids if i not in inside)
    scene.handles.select([some, others])
    assert draw(SHIFT | CTRL) == {some}
    assert draw(SHIFT) == inside
    scene.handles.select([some, others])
    assert draw(CTRL) == {others}


def test_inside_an_outline_by_closed_forms():
    random = np.random.default_rng()
    points = random.uniform(-2, 2, (500, 2))
    angles = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    away = np.linalg.norm(points, axis=1)
    clear = abs(away - 1.0) > 1e-3
    np.testing.assert_array_equal(picking.within(points, circle)[clear], (away < 1.0)[clear])


@pytest.mark.parametrize("axis", range(3))
def test_a_drag_along_an_axis_stays_on_it_and_under_the_mouse(controls, scene, axis):
    vertex = front_vertex(controls)
    press, start = pixel_of(controls, vertex), scene.handles.at([vertex])[0]
    controls.press(press, "left")
    controls.drag(press + np.array([10.0, 0.0]), 10, 0)
    controls.along(axis)
    aim = press + np.array([14.0, -9.0])
    controls.drag(aim, 4, -9)
    moved = scene.handles.grabbed.target.place - start
    assert np.delete(moved, axis) == pytest.approx([0.0, 0.0], abs=1e-9)
    # Of all points of the axis, none is nearer to the mouse's ray.
    eye, direction = picking.ray(controls.camera, aim)

    def gap(place):
        return np.linalg.norm(np.cross(place - eye, direction))

    step = 1e-3 * np.eye(3)[axis]
    here = scene.handles.grabbed.target.place
    assert gap(here) <= min(gap(here + step), gap(here - step))


def test_what_is_held_turns_with_the_mouse_around_its_center(controls, scene):
    a, b, _ = apart(controls)
    scene.handles.select([a, b])
    before = scene.handles.at([a, b])
    center = before.mean(axis=0)
    (middle,), _ = picking.project(controls.camera, center[None])
    press = pixel_of(controls, a)
    controls.press(press, "left")
    controls.drag(press + np.array([4.0, 0.0]), 4, 0)
    scene.handles.drag_to(before[0])
    controls.turn_into(drags.TURN)
    controls.drag(press, -4, 0)
    quarter = middle + rotation_2d(0.5) @ (controls.pointer - middle)
    controls.drag(quarter, 1, 1)
    scene.clock.advance(TIME_STEP)
    after = scene.handles.at([a, b])
    assert after.mean(axis=0) == pytest.approx(center, abs=1e-5)
    turn = rotation_matrix(scene.handles.grabbed.reached.rotation)
    np.testing.assert_allclose(after - center, (before - center) @ turn.T, atol=1e-5)
    angle = np.linalg.norm(scene.handles.grabbed.reached.rotation)
    assert 0.3 < angle < 0.7


def rotation_2d(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def test_what_is_held_is_scaled_about_its_center(controls, scene):
    a, b, _ = apart(controls)
    scene.handles.select([a, b])
    before = scene.handles.at([a, b])
    press = pixel_of(controls, a)
    controls.press(press, "left")
    controls.drag(press + np.array([4.0, 0.0]), 4, 0)
    scene.handles.drag_to(before[0])
    scene.handles.turn_to([0.0, 0.0, 0.0], 0.5)
    scene.clock.advance(TIME_STEP)
    after = scene.handles.at([a, b])
    np.testing.assert_allclose(after[1] - after[0], 0.5 * (before[1] - before[0]), atol=1e-5)
    assert after.mean(axis=0) == pytest.approx(before.mean(axis=0), abs=1e-5)


def test_the_wheel_takes_more_or_less_along_during_a_drag(controls, scene):
    scene.settings.grab_radius = 0.1
    vertex = front_vertex(controls)
    press = pixel_of(controls, vertex)
    controls.press(press, "left")
    controls.drag(press + np.array([20.0, 0.0]), 20, 0)
    scene.clock.advance(TIME_STEP)
    count, distance = len(scene.handles.grabbed.ids), scene.orbit.distance
    place = scene.handles.at([vertex])[0]
    controls.scroll(press, 6)
    assert len(scene.handles.grabbed.ids) > count and scene.orbit.distance == distance
    scene.clock.advance(TIME_STEP)
    np.testing.assert_allclose(scene.handles.at([vertex])[0], place, atol=1e-5)  # no jerk
    controls.scroll(press, -12)
    assert scene.handles.grabbed.radius < 0.1 * scene.size
    assert len(scene.handles.grabbed.ids) <= count


def test_a_double_click_makes_a_point_where_the_surface_is(controls, scene):
    depth = np.full((SIZE[1], SIZE[0]), 1.9, np.float32)
    controls.depth_image = lambda: depth
    scene.handle_bias = -10.0  # no sphere shows: the click goes to the surface
    pixel = np.array([160.0, 100.0])
    place = controls.surface_at(pixel)
    count = len(scene.handles.points)
    controls.click(pixel)
    controls.click(pixel)
    assert len(scene.handles.points) == count + 1
    (handle,) = scene.handles.selected
    assert scene.handles.at([handle])[0] == pytest.approx(place, abs=0.2)
    scene.undo()
    assert len(scene.handles.points) == count and scene.handles.selected == []


def test_hidden_points_are_not_taken_and_come_back(controls, scene):
    vertex = front_vertex(controls)
    scene.handles.select([vertex])
    assert scene.handles.hide() == 1
    assert vertex not in scene.handles.control_ids and scene.handles.selected == []
    assert controls.pick(pixel_of(controls, vertex)) != vertex
    scene.handles.unhide()
    assert vertex in scene.handles.control_ids
    scene.handles.name(vertex, "nose")
    assert scene.handles.title(vertex) == "nose"
    scene.undo()
    count = len(scene.pins)
    assert scene.handles.title(vertex) == f"point {vertex - count}"  # not "vertex 951" of 932
    assert scene.handles.title(count - 1) == f"vertex {count - 1}"


def test_what_shows_of_a_sphere_can_be_picked_and_what_is_hidden_cannot(controls, scene):
    """The sphere is half behind a wall: at each pixel, it's the pixel that counts."""
    vertex = front_vertex(controls)
    middle = pixel_of(controls, vertex)
    scene.handle_radius *= 4.0
    scene.handle_bias = 0.0
    _, (t,) = picking.project(controls.camera, scene.handles.at([vertex]))
    wall = np.full((SIZE[1], SIZE[0]), np.inf, np.float32)
    wall[:, int(middle[0]) + 2 :] = 0.5 * t
    controls.depth_image = lambda: wall
    radius = controls.camera.focal * scene.handle_radius / t
    assert controls.pick(middle - [0.5 * radius, 0.0]) is not None
    assert controls.pick(middle + np.array([0.5 * radius, 0.0])) is None
    wall[:] = 0.5 * t
    wall[:, : int(middle[0] - 0.5 * radius)] = np.inf  # its center is hidden, its rim isn't
    assert controls.pick(middle - [0.8 * radius, 0.0]) is not None
    assert controls.pick(middle) is None


def test_rotation_vectors_are_those_of_their_matrices():
    random = np.random.default_rng()
    for _ in range(50):
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        for angle in (0.0, 1e-9, *random.uniform(0.0, np.pi, 3), np.pi):
            again = rotation_matrix(rotation_vector(rotation_matrix(angle * axis)))
            np.testing.assert_allclose(again, rotation_matrix(angle * axis), atol=2e-6)


def test_p_pins_all_that_is_selected_in_one_step_and_frees_it_again(controls, scene):
    """Neighbors, too: the first one's patch takes in the second."""
    scene.settings.grab_radius = 0.3
    ids = [int(i) for i in scene.handles.control_ids[:3]]
    before = scene.solver.pinned.copy()
    scene.handles.select(ids)
    controls.pin()
    corners = np.concatenate([scene.handles.corners(one) for one in ids])
    assert scene.solver.pinned[corners].all()
    assert [step.label for step in scene.journal.steps] == ["pins"]
    controls.pin()
    assert not scene.solver.pinned[corners[~before[corners]]].any()
    pair = np.flatnonzero(scene.pins)[:2]
    scene.handles.set_pins(pair.tolist(), False)
    scene.handles.select(pair.tolist())
    controls.pin()
    assert scene.solver.pinned[pair].all()


def test_an_axis_that_points_at_the_eye_throws_nothing(controls, scene):
    """A pixel there would be many sizes of the object along it."""
    scene.orbit = replace(scene.orbit, yaw=0.0, pitch=0.0)
    vertex = front_vertex(controls)
    press = pixel_of(controls, vertex)
    controls.press(press, "left")
    controls.drag(press + np.array([5.0, 0.0]), 5, 0)
    controls.along(1)
    for way in range(-40, 41, 5):
        controls.drag(press + np.array([float(way), 0.5]), 1, 0)
        away = scene.handles.grabbed.target.place - scene.handles.grabbed.start
        assert np.linalg.norm(away) <= drags.FARTHEST_DRAG * scene.size * (1.0 + 1e-9)


def test_half_a_turn_goes_on_the_shorter_way():
    """Over several ticks of a frame, from just before half a turn to just behind it."""
    first = Motion(np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 3.1]))
    last = first.turned([0.0, 0.0, -3.1], 1.0)
    for share in (0.25, 0.5, 0.75):
        turned = rotation_matrix(first.towards(last, share).rotation)
        expected = rotation_matrix([0.0, 0.0, 3.1 + share * (2 * np.pi - 6.2)])
        np.testing.assert_allclose(turned, expected, atol=1e-5)


def test_esc_gives_the_grab_radius_back_that_the_wheel_widened(controls, scene):
    scene.settings.grab_radius = 0.1
    press = pixel_of(controls, front_vertex(controls))
    controls.press(press, "left")
    controls.drag(press + np.array([5.0, 0.0]), 5, 0)
    controls.scroll(press, 30)
    assert scene.settings.grab_radius == pytest.approx(GRAB_RADII[1])
    controls.cancel()
    assert scene.settings.grab_radius == pytest.approx(0.1)
