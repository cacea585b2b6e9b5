"""The timeline's strip and its actions, without a window: what a press, a drag and keys do."""

from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.viewer.actions import ACTIONS
from deformrf.viewer.document import Scene
from deformrf.viewer.document.timeline import strip as s
from deformrf.viewer.events import EventLog
from deformrf.viewer.tools import Controls


@pytest.fixture
def app(ball):
    """What actions need of an App; `said` are its messages."""
    said, scene = [], Scene(ball, "ball", "cpu")
    return SimpleNamespace(
        scene=scene,
        controls=Controls(scene, lambda: None, EventLog(False), said.append),
        recorder=SimpleNamespace(say=said.append),
        strip=s.Strip(scale=s.TimeScale(100.0, 600.0, 300)),
        said=said,
    )


@pytest.fixture
def line(app):
    return app.scene.timeline


def ticks(line, track="camera"):
    return [key.tick for key in line.keys[track]]


def keyed(app, *ticks_of_keys):
    for tick in ticks_of_keys:
        app.scene.timeline.scrub(tick)
        ACTIONS["key_camera"](app)


def dragged(app, start, end, track="camera", copy=False):
    app.strip.press(app.scene.timeline, track, start)
    app.strip.drag(app.scene.timeline, 0.5 * (start + end))
    app.strip.drag(app.scene.timeline, end)
    return app.strip.drop(app.scene.timeline, copy)


def test_places_and_ticks_belong_together():
    scale = s.TimeScale(100.0, 600.0, 300)
    assert [scale.tick(scale.place(tick)) for tick in range(300)] == list(range(300))
    assert scale.tick(-1e9) == 0 and scale.tick(1e9) == s.LONGEST


@pytest.mark.parametrize("ticks", [300, 1000, s.LONGEST])
@pytest.mark.parametrize("width", [1.0, 100.0, 5000.0])
def test_numbers_of_the_ruler_keep_apart(width, ticks):
    scale = s.TimeScale(0.0, width, ticks)
    apart = scale.place(scale.step * s.TICKS_PER_SECOND)
    assert apart >= s.NARROWEST or scale.step == s.STEPS[-1]


def test_a_drag_of_a_key_moves_it_when_it_is_let_go(app, line):
    keyed(app, 30, 90)
    steps = len(app.scene.journal.steps)
    dragged(app, 160.0, 220.0)  # over no other key: from tick 30 to 60
    assert ticks(line) == [60, 90] and app.strip.selected == ("camera", 60)
    assert len(app.scene.journal.steps) == steps + 1
    app.scene.undo()
    assert ticks(line) == [30, 90]


def test_a_drag_of_a_key_with_ctrl_copies_it(app, line):
    keyed(app, 30)
    dragged(app, 160.0, 300.0, copy=True)
    assert ticks(line) == [30, 100] and app.strip.selected == ("camera", 100)


def test_a_key_that_is_undone_while_it_is_dragged_is_told_of(app, line):
    keyed(app, 30)
    app.strip.press(line, "camera", 160.0)
    app.strip.drag(line, 300.0)
    ACTIONS["undo"](app)
    assert app.strip.drop(line, False) == "the camera key that you dragged is gone"
    assert ticks(line) == [] and app.strip.holds == ""


def test_a_press_beside_keys_takes_the_playhead(app, line):
    keyed(app, 30)
    dragged(app, 300.0, 400.0)
    assert line.head == 150 and ticks(line) == [30] and app.strip.selected is None
    dragged(app, 160.0, 420.0, track=None)  # on the ruler, above a key
    assert line.head == 160 and ticks(line) == [30]


def test_a_press_on_the_playhead_stops_what_plays(app, line):
    keyed(app, 0, 90)
    ACTIONS["play"](app)
    assert line.playing and line.head == 0
    dragged(app, 100.0, 100.0, track=None)
    assert not line.playing and line.head == 0


def test_the_key_at_the_playhead_is_chosen_and_what_is_gone_is_not(app, line):
    keyed(app, 30, 90)
    assert app.strip.chosen(line) == ("camera", 90)
    app.strip.selected = "camera", 30
    assert app.strip.chosen(line) == ("camera", 30)
    ACTIONS["delete_key"](app)
    assert ticks(line) == [90] and app.strip.chosen(line) == ("camera", 90)
    ACTIONS["delete_key"](app)
    ACTIONS["delete_key"](app)  # nothing is left
    assert ticks(line) == []


def test_keys_of_the_keyboard_walk_over_keys_and_copy(app, line):
    keyed(app, 0, 30, 90)
    ACTIONS["previous_key"](app)
    ACTIONS["previous_key"](app)
    ACTIONS["previous_key"](app)
    assert line.head == 0
    ACTIONS["next_key"](app)
    assert line.head == 30
    app.strip.selected = "camera", 0
    line.scrub(60)
    ACTIONS["copy_key"](app)
    assert ticks(line) == [0, 30, 60, 90]
    assert line.keys["camera"][2].orbit is line.keys["camera"][0].orbit


def test_a_key_of_both_is_one_step_and_shows_the_strip(app, line):
    ACTIONS["key"](app)
    assert ticks(line) == ticks(line, "pose") == [0] and app.scene.settings.show_timeline
    assert app.said == ["key of camera and pose at 0.00 s"]
    app.scene.undo()
    assert ticks(line) == ticks(line, "pose") == []


def test_play_says_that_there_are_no_keys(app, line):
    ACTIONS["play"](app)
    assert not line.playing and "no keys" in app.said[-1]


def test_a_turntable_is_one_click_and_one_step(app, line):
    app.strip.turn_seconds = 2.0
    before = app.scene.orbit
    ACTIONS["turntable"](app)
    assert line.playing and line.loop and line.end == 120 and line.head == 0
    for _ in range(60):
        app.scene.clock.tick()
    turned = (app.scene.orbit.yaw - before.yaw) % (2 * np.pi)
    assert turned == pytest.approx(np.pi)
    app.scene.undo()
    assert not line.playing and not line.end and not line.loop


def test_what_is_too_many_is_said(app, line, monkeypatch):
    keyed(app, 0, 30)
    monkeypatch.setattr("deformrf.viewer.document.timeline.timeline.MOST_KEYS", 2)
    monkeypatch.setattr("deformrf.viewer.document.timeline.timeline.MOST_POSES", 0)
    line.scrub(60)
    app.strip.selected = "camera", 0
    for action in ("key", "copy_key", "save_pose"):
        app.said.clear()
        ACTIONS[action](app)
        assert "at most 2" in app.said[0] or "delete one first" in app.said[0]
    assert "at most 2" in dragged(app, 100.0, 300.0, copy=True)
    assert ticks(line) == [0, 30] and app.strip.holds == ""


def test_poses_get_names(app, line):
    ACTIONS["save_pose"](app)
    app.strip.pose_name = " nod\n" + 100 * "x"
    ACTIONS["save_pose"](app)
    ACTIONS["save_pose"](app)
    names = [pose.name for pose in line.poses]
    assert names[0] == "pose 1" and names[1].startswith("nodx") and names[2] == "pose 2"
    assert len(names[1]) <= 60 and app.strip.pose_name == ""
