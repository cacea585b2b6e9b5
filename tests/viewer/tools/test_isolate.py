"""Isolate: a click, strokes, a preview in two colors, and one deletion that can be undone."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.field import pack_mask, subtet_middles, unpack_mask
from deformrf.core.render import Renderer
from deformrf.viewer.camera import project
from deformrf.viewer.document import Scene
from deformrf.viewer.document.history.undo import _same
from deformrf.viewer.tools import SHIFT

GAP = 0.03  # half of the slit between two halves


@pytest.fixture
def halves(ball):
    """The ball with a slit at x = ½: nothing joins the halves."""
    away = abs(subtet_middles(ball.mesh)[..., 0] - 0.5) > GAP
    return replace(ball, occupancy=pack_mask(unpack_mask(ball.occupancy) & away))


@pytest.fixture
def scene(halves):
    made = Scene(halves, "halves", "cpu")
    made.settings.tool = "isolate"
    return made


@pytest.fixture
def said():
    return []


@pytest.fixture
def controls(hand, halves, scene, said):
    renderer = Renderer(halves)
    renderer.set_vertices(halves.mesh.rest_vertices)
    made = hand(scene, lambda: renderer.render(made.camera).depth_array())
    made.say = said.append
    return made


def pixels_of_halves(scene, controls):
    """Of the place in each half that is nearest to the eye."""
    middles = subtet_middles(scene.field.mesh)[unpack_mask(scene.field.occupancy)]
    away = np.linalg.norm(middles - controls.camera.position, axis=1)
    right = middles[:, 0] > 0.5
    nearest = [middles[np.where(half, away, np.inf).argmin()] for half in (~right, right)]
    return project(controls.camera, np.array(nearest))[0]


def test_a_click_previews_one_half_and_enter_cuts_the_other_off(controls, scene, said):
    before = scene.states.now() | {"asleep": None}
    left, _ = pixels_of_halves(scene, controls)
    controls.click(left)
    places, ours, radius = controls.tools["isolate"].marks
    assert radius > 0.0 and not scene.journal.events
    np.testing.assert_array_equal(ours, places[:, 0] < 0.5)
    assert "Enter cuts off" in said[-1] and "% of the matter" in said[-1]
    assert controls.tool.enter()
    assert [event.name for event in scene.journal.events] == ["delete"]
    x = subtet_middles(scene.field.mesh)[..., 0]
    kept = pack_mask(x < 0.5) & scene.field.occupancy
    np.testing.assert_array_equal(scene.cuts.left, kept)
    assert scene.settings.tool == "grab" and controls.tools["isolate"].marks is None
    scene.undo()
    assert _same(before, scene.states.now() | {"asleep": None})


def test_strokes_of_both_kinds_add_up(controls, scene, said):
    left, right = pixels_of_halves(scene, controls)
    controls.click(left)
    controls.click(right)
    assert controls.tools["isolate"].marks[1].all()
    controls.press(right, "left", SHIFT)
    controls.drag(right + np.array([2.0, 20.0]), 2, 20)
    controls.release("left", SHIFT)
    strokes = controls.tools["isolate"].strokes
    assert [stroke.this for stroke in strokes] == [True, True, False]
    assert len(strokes[-1].points) == 2
    places, ours, _ = controls.tools["isolate"].marks
    assert ours[places[:, 0] < 0.5].all() and not ours[places[:, 0] > 0.5].all()


def test_esc_forgets_the_strokes_and_nothing_was_changed(controls, scene):
    controls.click(pixels_of_halves(scene, controls)[0])
    controls.escape()
    assert scene.settings.tool == "grab"
    assert controls.tools["isolate"].marks is None and not controls.tools["isolate"].strokes
    assert not scene.journal.events and not scene.cuts.some
    assert not controls.tools["isolate"].enter()


def test_the_first_stroke_has_to_say_this(controls, scene, said):
    controls.click(pixels_of_halves(scene, controls)[0], SHIFT)
    assert "first click the object" in said[-1]
    assert controls.tools["isolate"].marks is None and not controls.tools["isolate"].strokes


def test_beside_the_object_the_view_turns(controls, scene):
    yaw = scene.orbit.yaw
    controls.press(np.array([4.0, 4.0]), "left")
    controls.drag(np.array([40.0, 4.0]), 36, 0)
    controls.release("left")
    assert scene.orbit.yaw != yaw and not controls.tools["isolate"].strokes


def test_a_bent_object_is_worked_on_where_it_is(controls, halves, scene):
    """Strokes are kept at rest: the marks follow the vertices."""
    controls.click(pixels_of_halves(scene, controls)[0])
    places, *_ = controls.tools["isolate"].marks
    rest = controls.tools["isolate"].strokes[0].points
    x = subtet_middles(halves.mesh)[unpack_mask(halves.occupancy)]
    assert min(np.linalg.norm(x - rest[0], axis=1)) < 1e-6
    assert np.linalg.norm(places - x.mean(axis=0), axis=1).max() < 0.5
