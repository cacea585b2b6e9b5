"""What the mouse and the keys mean, without any window."""

import numpy as np
import pytest
from displaced import displacements

from deformrf.core.deform import TIME_STEP
from deformrf.viewer.camera import picking
from deformrf.viewer.document import Scene
from deformrf.viewer.tools import ALT, CTRL
from deformrf.viewer.tools.bend import STAYS
from deformrf.viewer.tools.brushes import PAUSED_BALL

SIZE = 320, 240


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


@pytest.fixture
def events():
    return []


@pytest.fixture
def controls(scene, events, hand):
    return hand(scene, lambda: None, lambda name, **fields: events.append((name, fields)))


def pixel_of(controls, vertex):
    pixels, _ = picking.project(controls.camera, controls.scene.handles.at([vertex]))
    return pixels[0]


def front_vertex(controls):
    """The control vertex nearest to the camera."""
    scene = controls.scene
    _, t = picking.project(controls.camera, scene.handles.at(scene.handles.control_ids))
    return int(scene.handles.control_ids[t.argmin()])


def test_a_dragged_vertex_stays_under_the_mouse(controls, scene):
    vertex = front_vertex(controls)
    press = pixel_of(controls, vertex) + np.array([2.0, -1.0])
    controls.press(press, "left")
    controls.drag(press + np.array([30.0, -20.0]), 30, -20)
    assert controls.mode == "grab"
    scene.clock.advance(1 / 30)
    assert pixel_of(controls, vertex) == pytest.approx(press + np.array([28.0, -19.0]), abs=0.01)
    forward = controls.camera.forward
    moved = scene.handles.at([vertex]) - scene.handles.at([vertex], scene.field.mesh.rest_vertices)
    assert moved[0] @ forward == pytest.approx(0, abs=1e-5)


def test_released_the_object_goes_back(controls, scene, events):
    press = pixel_of(controls, front_vertex(controls))
    controls.press(press, "left")
    controls.drag(press + np.array([20.0, 0.0]), 20, 0)
    scene.clock.advance(1 / 30)
    controls.release("left")
    assert (controls.mode, scene.handles.grabbed) == ("", None)
    for _ in range(300):
        scene.clock.advance(1 / 60)
    assert displacements(scene).max() < 0.01
    assert [name for name, _ in events] == ["grab", "release"]


@pytest.mark.parametrize("key, orbits", [(0, False), (ALT, True), (CTRL, False)])
def test_a_drag_on_the_object_takes_it_there(controls, scene, monkeypatch, key, orbits):
    place = scene.handles.at([front_vertex(controls)])[0]
    scene.settings.show_handles = False  # the red points are elsewhere
    monkeypatch.setattr(controls, "surface_at", lambda pixel, beside=True: place)
    pixels, _ = picking.project(controls.camera, place[None])
    controls.motion(pixels[0])
    np.testing.assert_array_equal(controls.tools["grab"].spot, place)
    count, view = len(scene.handles.points), scene.orbit
    controls.press(pixels[0], "left", modifiers=key)
    controls.drag(pixels[0] + 1.0, 1, -1)
    assert scene.handles.grabbed is None and controls.mode == "orbit"
    controls.drag(pixels[0] + [30.0, 0.0], 30, 0)
    assert (scene.handles.grabbed is None) == orbits == (scene.orbit.yaw != view.yaw)
    scene.clock.advance(1 / 30)
    if not orbits:
        assert pixel_of(controls, scene.handles.grabbed.handles[0]) == pytest.approx(
            pixels[0] + [30.0, 0.0], abs=0.1
        )
    controls.release("left")
    assert scene.handles.grabbed is None and len(scene.handles.points) == count


def test_drags_can_be_left_to_red_points(controls, scene, monkeypatch):
    monkeypatch.setattr(controls, "surface_at", lambda pixel, beside=True: scene.center)
    scene.settings.show_handles = scene.settings.grab_anywhere = False
    controls.press(np.array([160.0, 120.0]), "left")
    controls.drag(np.array([200.0, 120.0]), 40, 0)
    assert scene.handles.grabbed is None and controls.mode == "orbit"


def test_in_pose_it_stays_a_click_lets_it_go_and_p_pins_it(controls, scene):
    said = []
    controls.say = said.append
    scene.settings.hand = "pose"
    vertex = front_vertex(controls)
    for pinned in False, True:
        press = pixel_of(controls, vertex)
        controls.press(press, "left")
        controls.drag(press + np.array([20.0, 0.0]), 20, 0)
        scene.clock.advance(1 / 30)
        controls.release("left")
        assert scene.handles.posed == (vertex,) and said.pop() == STAYS
        if pinned:
            scene.handles.hover = vertex
            controls.pin()
        else:
            controls.press(pixel_of(controls, vertex), "left")
            controls.release("left")
        assert not scene.handles.posed and not scene.handles.selected
        assert scene.handles.is_pinned(vertex) == pinned


def test_pins_do_not_move_with_a_drag(controls, scene):
    scene.settings.grab_radius = 2.0  # everything
    press = pixel_of(controls, front_vertex(controls))
    controls.press(press, "left")
    controls.drag(press + np.array([30.0, 0.0]), 30, 0)
    scene.clock.advance(1 / 30)
    assert displacements(scene)[scene.pins].max() < 1e-6
    assert displacements(scene)[~scene.pins].max() > 0.05


def front_pin(controls):
    """The pin nearest to the camera."""
    scene = controls.scene
    _, t = picking.project(controls.camera, scene.handles.at(scene.handles.pin_ids))
    return int(scene.handles.pin_ids[t.argmin()])


def test_a_click_on_a_pin_frees_it_and_a_drag_from_there_orbits(controls, scene, events):
    scene.handles.set_pin(int(scene.handles.control_ids[0]), True)  # one is above the others
    for pin in (int(scene.handles.pin_ids[0]), front_pin(controls)):
        at, before = pixel_of(controls, pin), scene.orbit
        controls.press(at, "left")
        if controls.mode == "pick":  # a control point lies in front of it
            controls.release("left")
            continue
        controls.drag(at + np.array([20.0, 0.0]), 20, 0)
        controls.release("left")
        assert scene.orbit.yaw != before.yaw
        scene.orbit = before
        count = scene.solver.pinned.sum()
        controls.press(at, "left")
        controls.drag(at + np.array([1.0, 1.0]), 1, 1)  # a hand isn't that steady
        controls.release("left")
        assert scene.orbit is before
        patch = scene.handles.patches[pin]
        assert scene.solver.pinned.sum() <= count - 1 and not patch
    assert "free" in [name for name, _ in events]


@pytest.mark.parametrize("by", ["hover", "selection"])
def test_p_pins_what_is_under_the_mouse_or_selected(controls, scene, events, by):
    vertex = front_vertex(controls)
    if by == "hover":
        controls.motion(pixel_of(controls, vertex))
    else:
        controls.click(pixel_of(controls, vertex))
    controls.pin()
    assert scene.solver.pinned[scene.handles.corners(vertex)].all()
    assert scene.handles.grabbed is None and "pin" in [name for name, _ in events]
    assert controls.pick(pixel_of(controls, vertex)) != vertex


def test_beside_a_vertex_the_left_button_orbits(controls, scene):
    before = scene.orbit
    controls.press((5, 5), "left")
    controls.drag((15, 5), 10, 0)
    controls.release("left")
    assert scene.orbit.yaw != before.yaw
    assert scene.orbit.target == pytest.approx(before.target)


@pytest.mark.parametrize("button", ["middle", "right"])
def test_the_other_buttons_pan_even_on_a_vertex(controls, scene, button):
    before = scene.orbit
    controls.press(pixel_of(controls, front_vertex(controls)), button)
    controls.drag((0, 0), 10, 0)
    controls.release(button)
    assert scene.orbit.yaw == before.yaw
    assert np.linalg.norm(scene.orbit.target - before.target) > 0


def test_a_second_button_changes_nothing(controls, scene):
    controls.press((5, 5), "left")
    controls.press((5, 5), "right")
    assert controls.mode == "orbit"
    controls.release("right")
    assert controls.mode == "orbit"
    controls.release("left")
    assert controls.mode == ""


def test_the_wheel_keeps_the_point_under_the_mouse(controls, scene):
    depth = np.full((24, 32), 1.9, np.float32)
    controls.depth_image = lambda: depth
    pixel = np.array([200.0, 90.0])
    point = controls.surface_at(pixel)
    before = scene.orbit.distance
    controls.scroll(pixel, 2)
    assert scene.orbit.distance < before
    pixels, _ = picking.project(controls.camera, point[None])
    assert pixels[0] == pytest.approx(pixel)


def test_a_vertex_hidden_behind_the_object_is_not_picked(controls, scene):
    vertex = front_vertex(controls)
    pixel = pixel_of(controls, vertex)
    controls.motion(pixel)
    assert scene.handles.hover == vertex
    controls.depth_image = lambda: np.full((24, 32), 0.5, np.float32)
    controls.motion(pixel)
    assert scene.handles.hover is None


@pytest.mark.parametrize("tool", ["bones", "joints"])
def test_over_bones_no_point_shows_is_picked_or_drawn(controls, scene, tool):
    from deformrf.viewer.layers.handle_layer import sphere_instances

    vertex = front_vertex(controls)
    at = pixel_of(controls, vertex)
    ids, eye = scene.handles.control_ids, controls.camera.position
    assert controls.shown(ids).any() and len(sphere_instances(scene, eye))
    controls.take_tool(tool)
    assert controls.pick(at) is None and not controls.shown(ids).any()
    assert not len(sphere_instances(scene, eye))
    controls.escape()
    assert controls.pick(at) == vertex


def test_hidden_handles_cannot_be_grabbed(controls, scene):
    scene.settings.show_handles = False
    controls.press(pixel_of(controls, front_vertex(controls)), "left")
    assert controls.mode == "orbit"


def test_cancel_puts_everything_back(controls, scene):
    before = scene.positions.copy()
    press = pixel_of(controls, front_vertex(controls))
    controls.press(press, "left")
    controls.drag(press + np.array([40.0, 10.0]), 40, 10)
    scene.clock.advance(1 / 30)
    controls.cancel()
    assert scene.positions == pytest.approx(before)
    controls.drag(press, 1, 1)  # the button is still down
    controls.release("left")
    assert scene.handles.grabbed is None


@pytest.mark.parametrize("ending", ["release", "cancel"])
def test_a_drag_goes_on_without_a_vertex_that_was_let_go_by_something_else(
    controls, scene, events, ending
):
    press = pixel_of(controls, front_vertex(controls))
    controls.press(press, "left")
    controls.drag(press + np.array([10.0, 0.0]), 10, 0)
    scene.reset()
    controls.drag(press + np.array([20.0, 0.0]), 20, 0)
    controls.release("left") if ending == "release" else controls.cancel()
    assert (controls.mode, scene.handles.grabbed) == ("", None)
    assert [name for name, _ in events] == ["grab"]


def test_a_ball_pushes_what_is_under_the_mouse(controls, scene, events):
    """It starts before the surface, goes with the mouse, and is gone when the button is up."""
    scene.settings.tool = "push"
    pixel = pixel_of(controls, front_vertex(controls))
    controls.press(pixel, "left")
    assert controls.mode == "push" and scene.handles.grabbed is None
    start = scene.ball.target.copy()
    side, _, forward = controls.camera.camera_to_world[:3, :3].T
    for _ in range(20):
        controls.drag(pixel + np.array([60.0, 0.0]), 0, 0)
        scene.clock.advance(TIME_STEP)
    moved = scene.ball.reached - start
    assert moved @ side > 0.05 and abs(moved @ forward) < 1e-6
    inside = np.linalg.norm(scene.positions - scene.ball.reached, axis=1) < 0.99 * scene.ball.radius
    assert not inside[~scene.solver.pinned].any()
    controls.release("left")
    assert scene.ball is None and not scene.solver.options.colliders
    assert [name for name, _ in events] == ["push", "end_push"]


@pytest.mark.parametrize("stands", [False, True], ids=["paused", "at a timeline's pose"])
def test_a_ball_says_why_it_waits_or_lets_time_go_on(controls, scene, stands):
    said = []
    controls.say = said.append
    scene.settings.tool = "push"
    if stands:
        scene.timeline.key(0, None, True)
        scene.timeline.scrub(0)
    else:
        scene.clock.paused = True
    assert scene.clock.paused
    controls.press(pixel_of(controls, front_vertex(controls)), "left")
    assert scene.clock.paused != stands and said == ([] if stands else [PAUSED_BALL])


def test_escape_and_reset_take_the_ball_away(controls, scene):
    scene.settings.tool = "push"
    pixel = pixel_of(controls, front_vertex(controls))
    controls.press(pixel, "left")
    controls.cancel()
    assert scene.ball is None and controls.mode == ""
    controls.press(pixel, "left")
    scene.reset()
    controls.drag(pixel + np.array([20.0, 0.0]), 0, 0)  # the button is still down
    controls.release("left")
    assert scene.ball is None and not scene.solver.options.colliders


@pytest.mark.parametrize("tool, stiffer", [("stiffen", True), ("soften", False)])
def test_a_brush_changes_what_the_mouse_passes(controls, scene, tool, stiffer):
    scene.settings.tool, scene.settings.grab_radius = tool, 0.2
    near = scene.handles.corners(front_vertex(controls))
    vertex = int(near[scene.positions[near, 2].argmax()])  # one on the ball
    point = scene.handles.at([vertex])[0]
    controls.surface_at = lambda pixel, beside=True: point
    pixel = pixel_of(controls, vertex)
    controls.press(pixel, "left")
    for _ in range(5):
        controls.drag(pixel, 0, 0)
    controls.release("left")
    factor = scene.body.factors[vertex]
    assert factor == pytest.approx(1.2**6 if stiffer else 1.2**-6)
    assert scene.handles.grabbed is None and controls.mode == ""


def test_a_brush_beside_the_object_paints_nothing(controls, scene):
    scene.settings.tool = "stiffen"
    controls.surface_at = lambda pixel, beside=True: None
    controls.press((5, 5), "left")
    controls.release("left")
    assert scene.body.factors is None


def test_another_tool_may_be_chosen_while_the_brush_is_down(controls, scene):
    scene.settings.tool = "stiffen"
    point = scene.handles.at([front_vertex(controls)])[0]
    controls.surface_at = lambda pixel, beside=True: point
    controls.press((5, 5), "left")
    scene.settings.tool = "push"
    controls.drag((5, 5), 0, 0)
    controls.release("left")
    assert scene.ball is None and controls.mode == ""


def test_a_pin_under_the_mouse_is_marked(controls, scene):
    """It is what a click would free."""
    _, t = picking.project(controls.camera, scene.handles.at(scene.handles.pin_ids))
    pin = int(scene.handles.pin_ids[t.argmin()])
    pixel = pixel_of(controls, pin)
    assert controls.pick(pixel) is None
    controls.motion(pixel)
    assert scene.handles.hover == pin
    controls.press(pixel, "left")
    controls.release("left")
    assert not scene.solver.pinned[pin]


@pytest.mark.parametrize("beside", [False, True])
def test_zooming_in_stops_before_the_surface(scene, hand, beside):
    """However often, and also where the wheel turns beside the object."""
    eye = [None]

    def depth_image():  # of a wall through the object's middle that faces the eye
        distance = np.linalg.norm(eye[0].camera.position - scene.center)
        depth = np.full(SIZE[::-1], distance)
        depth[:, : SIZE[0] // 4] = np.inf
        return depth

    eye[0] = made = hand(scene, depth_image, lambda *_, **__: None)
    for _ in range(60):
        made.scroll(np.array([20.0 if beside else 160.0, 120.0]), 1)
    assert depth_image().min() > 0.049 * scene.size
    away = depth_image().min()
    made.scroll(np.array([160.0, 120.0]), -1)
    assert depth_image().min() > away
