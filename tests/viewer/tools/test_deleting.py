"""Brush, box and lasso delete what is under them in the view, as the mouse says."""

import numpy as np
import pytest

from deformrf.core.field import SUBTET_COUNT, subtet_middles, unpack_mask
from deformrf.core.render import Renderer
from deformrf.viewer.camera import project
from deformrf.viewer.document import Scene, masks_of
from deformrf.viewer.document.history.undo import _same
from deformrf.viewer.tools import CTRL, SHIFT, brushes


def state_of(scene):
    """The scene's state; whether the solver sleeps is known again some steps after an undo."""
    return scene.states.now() | {"asleep": None}


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


@pytest.fixture
def renderer(ball):
    made = Renderer(ball)
    made.set_vertices(ball.mesh.rest_vertices)
    return made


@pytest.fixture
def said():
    return []


@pytest.fixture
def controls(hand, scene, renderer, said):
    """A hand that sees the object's depths."""
    made = hand(scene, lambda: renderer.render(made.camera).depth_array())
    made.say = said.append
    return made


def middle_of(scene, controls):
    """The pixel of the object's middle."""
    return project(controls.camera, scene.center[None])[0][0]


def removed(scene, controls):
    """Pixels [N, 2] and distances [N] of what was deleted and of what is left."""
    parts = []
    for masks in (scene.cuts.removed & scene.field.occupancy, scene.cuts.left):
        places = subtet_middles(scene.field.mesh)[unpack_mask(masks)]
        parts.append(project(controls.camera, places))
    return parts


def test_masks_have_the_sub_tets_that_were_given():
    random = np.random.default_rng()
    chosen = random.random((9, SUBTET_COUNT)) < 0.3
    np.testing.assert_array_equal(unpack_mask(masks_of(*np.nonzero(chosen), 9)), chosen)


def test_a_click_of_the_brush_takes_one_layer_and_shows_it_before_the_button_is_up(
    controls, scene, renderer, said
):
    scene.settings.tool, scene.settings.brush_radius = "delete", 14.0
    pixel = middle_of(scene, controls)
    surface = renderer.render(controls.camera).depth_array()
    controls.press(pixel, "left")
    assert controls.mode == "delete"
    assert scene.cuts.some and not scene.journal.events
    controls.release("left")
    assert [event.name for event in scene.journal.events] == ["delete"]
    assert "tets are left" in said[-1]
    (pixels, away), (pixels_left, away_left) = removed(scene, controls)
    assert len(pixels) > 20
    assert (np.linalg.norm(pixels - pixel, axis=1) <= 14.0).all()
    front = surface[int(pixel[1]), int(pixel[0])]
    edge = np.linalg.norm(np.diff(scene.field.mesh.rest_vertices[scene.field.mesh.tets], axis=1))
    assert away.max() < front + edge
    under = np.linalg.norm(pixels_left - pixel, axis=1) <= 10.0
    assert under.sum() > 20  # what is behind stays
    assert away_left[under].min() > front
    # A second click goes deeper.
    renderer.set_occupancy(scene.cuts.left)
    controls.click(pixel)
    assert removed(scene, controls)[0][1].max() > away.max()


def test_with_shift_the_brush_takes_all_through_along_the_whole_way_of_a_drag(controls, scene):
    scene.settings.tool, scene.settings.brush_radius = "delete", 10.0
    start = middle_of(scene, controls) - np.array([40.0, 0.0])
    end, before = start + np.array([80.0, 0.0]), state_of(scene)
    controls.press(start, "left", SHIFT)
    controls.drag(end, 80, 0)  # in one jump
    controls.release("left")
    _, (pixels, _) = removed(scene, controls)
    on_way = (abs(pixels[:, 1] - start[1]) < 9.9) & (pixels[:, 0] > start[0])
    assert not (on_way & (pixels[:, 0] < end[0])).any()
    assert len(scene.journal.steps) == 1
    scene.undo()
    assert _same(before, state_of(scene))


def test_esc_gives_a_stroke_up_and_then_the_tool(controls, scene):
    scene.settings.tool = "delete"
    controls.press(middle_of(scene, controls), "left")
    controls.cancel()
    assert controls.mode == "" and not scene.cuts.some and not scene.journal.events
    assert scene.settings.tool == "delete"
    controls.escape()
    assert scene.settings.tool == "grab"


def test_beside_the_object_the_brush_turns_the_view(controls, scene):
    scene.settings.tool, yaw = "delete", scene.orbit.yaw
    controls.press(np.array([4.0, 4.0]), "left")
    controls.drag(np.array([40.0, 4.0]), 36, 0)
    controls.release("left")
    assert scene.orbit.yaw != yaw and not scene.cuts.some


def test_the_wheel_sets_the_size_of_the_brush_and_does_not_zoom(controls, scene):
    scene.settings.tool, distance = "delete", scene.orbit.distance
    controls.scroll(np.array([160.0, 120.0]), 3)
    assert scene.settings.brush_radius == pytest.approx(24.0 * brushes.WIDER_PER_NOTCH**3)
    controls.scroll(np.array([160.0, 120.0]), -100)
    assert scene.settings.brush_radius == brushes.BRUSH_RADII[0]
    assert scene.orbit.distance == distance


@pytest.mark.parametrize("others", [False, True])
@pytest.mark.parametrize("tool", ["delete box", "delete lasso"])
def test_a_region_takes_what_is_in_it_or_around_it(controls, scene, tool, others):
    middle = middle_of(scene, controls)
    scene.settings.tool = tool
    low, high = middle + np.array([[-30.0, -60.0], [30.0, -5.0]])
    corners = [low, np.array([high[0], low[1]]), high, np.array([low[0], high[1]])]
    controls.press(low, "left")
    for corner in corners[1:] if tool == "delete lasso" else [high]:
        controls.drag(corner, 0, 0)
    controls.release("left", CTRL if others else 0)
    assert scene.settings.tool == tool and controls.mode == ""
    (gone, _), (left, _) = removed(scene, controls)
    assert len(gone) > 50 and len(left) > 50
    for pixels, is_gone in ((gone, True), (left, False)):
        inside = ((pixels > low) & (pixels < high)).all(axis=1)
        assert (inside == (is_gone != others)).all()


def test_a_region_around_nothing_and_one_around_all_change_nothing(controls, scene, said):
    scene.settings.tool = "delete box"
    for start, end, words in (
        ((1.0, 1.0), (8.0, 8.0), "nothing to delete"),
        ((0.0, 0.0), (320.0, 240.0), "nothing of the object would be left"),
    ):
        controls.press(np.array(start), "left")
        controls.drag(np.array(end), 0, 0)
        controls.release("left")
        assert words in said[-1]
    assert not scene.cuts.some and not scene.journal.steps


def test_what_is_deleted_is_not_picked(controls, scene, renderer):
    handle = controls_front(controls, scene)
    pixel = controls.pixel_of(handle)
    assert controls.pick(pixel) == handle
    scene.settings.tool, scene.settings.brush_radius = "delete", 30.0
    controls.press(pixel, "left", SHIFT)
    controls.release("left")
    scene.settings.tool = "grab"
    renderer.set_occupancy(scene.cuts.left)
    assert controls.pick(pixel) is None
    assert controls.surface_at(pixel, beside=False) is None


def controls_front(controls, scene):
    """The control point nearest to the camera."""
    ids = scene.handles.control_ids
    return int(ids[project(controls.camera, scene.handles.at(ids))[1].argmin()])
