"""Isolate: a click, strokes, a preview in two colors, and one deletion that can be undone."""

import gc
import time
import weakref
from dataclasses import replace
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.core.field import pack_mask, subtet_middles, unpack_mask
from deformrf.core.render import Renderer
from deformrf.viewer.camera import project
from deformrf.viewer.document import Scene
from deformrf.viewer.document.history.undo import _same
from deformrf.viewer.tools import SHIFT
from deformrf.viewer.tools import isolate as isolating
from deformrf.viewer.tools.isolate import OTHERS, OURS

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


def marked(controls):
    """Places of marks [n, 3], and which are the object's [n] bool, once that is found out."""
    tool, end = controls.tools["isolate"], time.monotonic() + 60.0
    marks = tool.marks
    while tool.busy:
        assert time.monotonic() < end
        time.sleep(0.01)
        marks = tool.marks
    if marks is None:
        return None
    places, tints, radius = marks
    assert radius > 0.0
    ours = (tints == OURS).all(axis=1)
    assert (ours | (tints == OTHERS).all(axis=1)).all()
    return places, ours


def test_a_click_previews_one_half_and_enter_cuts_the_other_off(controls, scene, said):
    before = scene.states.now() | {"asleep": None}
    left, _ = pixels_of_halves(scene, controls)
    controls.click(left)
    places, ours = marked(controls)
    assert not scene.journal.events
    np.testing.assert_array_equal(ours, places[:, 0] < 0.5)
    assert "orange goes: 50% of the matter" in controls.tool.told
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
    assert marked(controls)[1].all()
    controls.press(right, "left", SHIFT)
    controls.drag(right + np.array([2.0, 20.0]), 2, 20)
    controls.release("left", SHIFT)
    strokes = controls.tools["isolate"].strokes
    assert [stroke.this for stroke in strokes] == [True, True, False]
    assert len(strokes[-1].points) == 2
    places, ours = marked(controls)
    assert ours[places[:, 0] < 0.5].all() and not ours[places[:, 0] > 0.5].all()


def test_esc_forgets_the_strokes_and_nothing_was_changed(controls, scene):
    controls.click(pixels_of_halves(scene, controls)[0])
    controls.escape()
    assert scene.settings.tool == "grab"
    assert marked(controls) is None and not controls.tools["isolate"].strokes
    assert not scene.journal.events and not scene.cuts.some


def test_the_first_stroke_has_to_say_this(controls, scene, said):
    controls.click(pixels_of_halves(scene, controls)[0], SHIFT)
    assert "first click the object" in said[-1]
    assert marked(controls) is None and not controls.tools["isolate"].strokes
    assert controls.tool.enter() and not scene.journal.events  # Enter is not the timeline's now


def test_beside_the_object_the_view_turns(controls, scene, said):
    yaw = scene.orbit.yaw
    controls.press(np.array([4.0, 4.0]), "left")
    controls.drag(np.array([40.0, 4.0]), 36, 0)
    controls.release("left")
    assert scene.orbit.yaw != yaw and not controls.tools["isolate"].strokes and not said
    controls.click(np.array([4.0, 4.0]))
    assert said == [isolating.BESIDE]


def test_a_bent_object_is_worked_on_where_it_is(controls, halves, scene):
    """Strokes are kept at rest: the marks follow the vertices."""
    controls.click(pixels_of_halves(scene, controls)[0])
    places, _ = marked(controls)
    rest = controls.tools["isolate"].strokes[0].points
    x = subtet_middles(halves.mesh)[unpack_mask(halves.occupancy)]
    assert min(np.linalg.norm(x - rest[0], axis=1)) < 1e-6
    assert np.linalg.norm(places - x.mean(axis=0), axis=1).max() < 0.5


def test_undo_takes_strokes_back_one_by_one_before_it_takes_steps_back(controls, scene):
    before = scene.journal.cursor
    left, right = pixels_of_halves(scene, controls)
    controls.click(left)
    controls.click(right)
    assert controls.undoes == "stroke" and controls.redoes != "stroke"
    assert controls.undo() == "stroke"
    places, ours = marked(controls)
    np.testing.assert_array_equal(ours, places[:, 0] < 0.5)
    assert controls.redo() == "stroke" and marked(controls)[1].all()
    assert controls.undo() == controls.undo() == "stroke"
    assert marked(controls) is None and scene.journal.cursor == before
    assert controls.redo() == "stroke"
    controls.click(right)  # a new stroke ends what could be brought again
    assert controls.redoes != "stroke" and len(controls.tool.strokes) == 2
    controls.take_tool("grab")
    assert controls.undoes != "stroke"


def test_the_window_goes_on_while_a_thread_looks(controls, scene, said, monkeypatch):
    """A click counts that comes before the model was looked at, and Enter has to wait."""
    real, may_go_on = isolating.fields.isolation_of, Event()

    def slow(field):
        assert may_go_on.wait(60.0)
        return real(field)

    monkeypatch.setattr(isolating.fields, "isolation_of", slow)
    controls.click(pixels_of_halves(scene, controls)[0])
    tool = controls.tool
    assert tool.marks is None and tool.busy
    time.sleep(isolating.SLOW)
    assert "looking at the model" in tool.told
    assert tool.enter() and said == [isolating.WAIT]
    may_go_on.set()
    places, ours = marked(controls)
    np.testing.assert_array_equal(ours, places[:, 0] < 0.5)


def test_the_thread_keeps_no_model_of_before_alive(hand, halves, monkeypatch):
    """Another one may be shown while it works."""
    may_go_on, real = Event(), isolating.fields.isolation_of
    monkeypatch.setattr(
        isolating.fields, "isolation_of", lambda field: may_go_on.wait(60.0) and real(field)
    )
    scene = Scene(halves, "halves", "cpu")
    scene.settings.tool = "isolate"
    controls = hand(scene)
    assert controls.tool.marks is None and controls.tool.busy
    known = weakref.ref(scene), weakref.ref(controls.tool)
    del scene, controls
    gc.collect()
    try:
        assert [one() for one in known] == [None, None]
    finally:
        may_go_on.set()


def test_what_the_thread_cannot_do_is_said_and_puts_the_tool_away(
    controls, scene, said, monkeypatch
):
    def fail(field):
        raise ModuleNotFoundError("no scipy", name="scipy")

    monkeypatch.setattr(isolating.fields, "isolation_of", fail)
    controls.click(pixels_of_halves(scene, controls)[0])
    assert marked(controls) is None
    assert said == [isolating.NEEDS_SCIPY] and scene.settings.tool == "grab"


def test_flat_parts_are_offered_first_and_can_be_left_out_alone(hand, ball, said, monkeypatch):
    low = ball.mesh.rest_vertices[:, 2].min() + 0.06
    floor = subtet_middles(ball.mesh)[..., 2] < low

    def without_flats(isolation):  # which test_isolating.py tests
        kept = ~floor[isolation.matter.tets, isolation.matter.subtets]
        return isolating.fields.Isolated(kept, (SimpleNamespace(reason=1),))

    monkeypatch.setattr(isolating.fields, "without_flats", without_flats)
    scene = Scene(ball, "ball", "cpu")
    scene.settings.tool = "isolate"
    controls = hand(scene)
    controls.say = said.append
    places, ours = marked(controls)
    assert not ours.any() and (places[:, 2] < low).all()
    assert "Enter leaves it out" in controls.tool.told
    left, may_go_on = scene.cuts.left, Event()
    monkeypatch.setattr(isolating.fields, "isolated", lambda *_: may_go_on.wait(60.0))
    controls.tool.strokes = (None,)
    _, tints, _ = controls.tool.marks  # the same until the stroke is worked out
    assert controls.tool.busy and (tints == OTHERS).all()
    controls.tool.forget()
    may_go_on.set()
    marked(controls)
    assert controls.tool.enter() and scene.settings.tool == "isolate"
    np.testing.assert_array_equal(scene.cuts.left, left & ~pack_mask(floor))
    assert controls.undo() == "delete"
    np.testing.assert_array_equal(scene.cuts.left, left)
    assert marked(controls) is not None
