"""Views of a scene: saved, gone to, kept in sessions, undone; what is up."""

from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.viewer.actions import ACTIONS, AXIS_VIEWS, FROM_VIEW, UPS, action_of, set_up, up_name
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import picking
from deformrf.viewer.document import (
    Event,
    Player,
    Scene,
    Session,
    SessionError,
    load_session,
    save_session,
    start_of,
)
from deformrf.viewer.films.film import Views
from deformrf.viewer.tools import SHIFT, Controls


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


@pytest.fixture
def app_like(scene):
    said = []
    return SimpleNamespace(scene=scene, recorder=SimpleNamespace(say=said.append), said=said)


def test_a_saved_view_is_gone_back_to(scene, app_like):
    first = scene.orbit
    scene.viewpoint.new_name = "  the side\n"
    ACTIONS["save_view"](app_like)
    scene.orbit = orbits.turned(orbits.with_up(scene.orbit, UPS["-y"]), 30, 10, 100)
    second = scene.orbit
    ACTIONS["save_view"](app_like)
    assert list(scene.viewpoint.saved) == ["the side", "view 1"]
    ACTIONS["next_view"](app_like)
    assert app_like.said[-1] == "view: the side"
    np.testing.assert_array_equal(scene.orbit.pose, first.pose)
    ACTIONS["next_view"](app_like)
    np.testing.assert_array_equal(scene.orbit.pose, second.pose)
    scene.viewpoint.delete("view 1")
    assert list(scene.viewpoint.saved) == ["the side"]


def test_without_saved_views_there_is_no_next_one(scene, app_like):
    before = scene.orbit
    ACTIONS["next_view"](app_like)
    assert app_like.said == ["no view is saved yet"] and scene.orbit is before


def test_undo_takes_back_a_saved_view_and_leaves_the_camera(scene):
    scene.viewpoint.save()
    scene.viewpoint.delete("view 1")
    scene.orbit = there = orbits.turned(scene.orbit, 30, 10, 100)
    scene.undo()
    assert list(scene.viewpoint.saved) == ["view 1"] and scene.orbit is there
    scene.undo()
    assert not scene.viewpoint.saved
    scene.redo()
    scene.redo()
    assert not scene.viewpoint.saved and scene.journal.redoes == ""


def test_a_session_has_the_views(scene, ball, tmp_path):
    start = start_of(scene)
    scene.viewpoint.save()
    scene.orbit = orbits.changed(scene.orbit, {"parallel": True, "roll": 0.2, "up": UPS["-x"]})
    scene.note_view()
    scene.clock.tick()
    path = save_session(scene, start, tmp_path / "views.jsonl")
    again = Scene(ball, "ball", "cpu")
    Player(again, load_session(path, ball)).play_to(1)
    assert again.viewpoint.saved == scene.viewpoint.saved != {}
    np.testing.assert_array_equal(again.orbit.pose, scene.orbit.pose)
    assert again.orbit.parallel and again.orbit.up == UPS["-x"]
    for wrong, right in (("[-1.0, 0.0, 0.0]", "[-1.0, 0.5, 0.0]"), ('"view 1"', '"view\\n"')):
        damaged = tmp_path / "damaged.jsonl"
        damaged.write_text(path.read_text().replace(wrong, right))
        with pytest.raises(SessionError):
            load_session(damaged, ball)


@pytest.mark.parametrize("name", UPS)
def test_up_is_chosen_by_its_axis(scene, name):
    set_up(scene.viewpoint, name)
    assert up_name(scene.orbit) == name
    assert scene.orbit.pose[:3, 1] @ UPS[name] > 0.0
    scene.viewpoint.home()
    assert up_name(scene.orbit) == name  # it is the capture's
    app = SimpleNamespace(scene=scene)
    for view, (_, pitch, _) in AXIS_VIEWS.items():
        ACTIONS[view](app)
        away = scene.orbit.pose[:3, 2] @ UPS[name]
        assert away == pytest.approx(np.sin(np.radians(pitch)), abs=1e-9)


def test_up_can_be_that_of_the_picture(scene):
    scene.orbit = orbits.changed(scene.orbit, {"roll": 0.5, "pitch": 0.2})
    before = scene.orbit.pose
    set_up(scene.viewpoint, FROM_VIEW)
    assert scene.orbit.pose == pytest.approx(before)
    assert scene.orbit.roll == 0.0 and up_name(scene.orbit) == FROM_VIEW


def test_the_axis_views_are_on_both_number_rows_and_their_backs_on_shift():
    for key in ("_1", "NUM_1", "NUM_END"):
        assert action_of(key) == "front"
        assert action_of(key, SHIFT) == "back"
    assert action_of("POUND", SHIFT) == "left"  # what X11 calls Shift+3
    assert action_of("NUM_5") == "toggle_parallel"
    assert action_of("NUM_PAGE_DOWN", SHIFT) == "left"
    assert action_of("R", SHIFT) == "reset"  # Shift alone changes no other key


def test_depths_of_parallel_rays_are_those_of_the_object(scene):
    ACTIONS["toggle_parallel"](SimpleNamespace(scene=scene))
    low, high = scene.viewpoint.depth_range
    t = (scene.positions - scene.orbit.pose[:3, 3]) @ -scene.orbit.pose[:3, 2]
    assert low < t.min() and t.max() < high
    scene.orbit = orbits.panned(scene.orbit, 500, 0, 240)
    assert scene.viewpoint.depth_range == pytest.approx((low, high))


def test_a_film_cuts_where_another_direction_is_up():
    first = orbits.Orbit(yaw=0.2, roll=-3.1)
    second = {"yaw": 0.6, "roll": 3.1}

    def at(tick, values):
        return Views(Session({"ticks": 10}, [Event(10, "view", values)]), first).at(tick)

    middle = at(5.0, second)
    assert middle.yaw == pytest.approx(0.4)
    assert abs(middle.roll) == pytest.approx(np.pi)  # the shorter way around
    for other in ({"up": UPS["+y"]}, {"parallel": True}):
        assert at(9.0, second | other) is first


@pytest.mark.parametrize("up", ["+z", "-y"])
def test_a_handle_follows_the_mouse_in_an_orthographic_view(scene, up):
    controls = Controls(scene, lambda: None, lambda *_, **__: None)
    controls.size = 320, 240
    scene.orbit = orbits.changed(scene.orbit, {"parallel": True, "up": UPS[up], "roll": 0.3})

    def pixel():
        (at,), _ = picking.project(controls.camera, scene.handles.at([handle]))
        return at

    handles = scene.handles.control_ids
    _, t = picking.project(controls.camera, scene.handles.at(handles))
    handle = int(handles[t.argmin()])  # none is before it
    x, y = (round(v) for v in pixel() - 0.5)
    controls.on_mouse_press(x, 239 - y, 1, 0)
    start = pixel()
    controls.on_mouse_drag(x + 20, 239 - y + 10, 20, 10, 1, 0)
    scene.clock.advance(4 / 60)
    assert scene.handles.hover == handle
    assert pixel() - start == pytest.approx([20, -10], abs=1.0)
