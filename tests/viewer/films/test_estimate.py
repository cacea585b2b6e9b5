"""How long a film takes: sessions that are played in little time, and when an estimate begins."""

import sys
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.document import Player, Scene, load_session, save_session, start_of
from deformrf.viewer.films import Film, Hurry, with_timeline
from deformrf.viewer.films.estimate import Estimator


@pytest.fixture
def session(ball, tmp_path):
    """A session of a drag, after which the camera moves on a timeline of two keys."""
    scene = Scene(ball, "ball", "cpu")
    start = start_of(scene)
    scene.clock.advance(1 / 60)
    scene.handles.grab(int(scene.handles.control_ids[0]))
    for _ in range(20):
        scene.handles.drag_to(np.add(scene.handles.grabbed.target.place, [0.0, 0.0, 0.01]))
        scene.clock.advance(1 / 60)
    scene.handles.release()
    scene.timeline.key(0, asdict(scene.orbit), False)
    scene.orbit = orbits.turned(scene.orbit, 40.0, 5.0, 64)
    scene.timeline.key(30, asdict(scene.orbit), False)
    for _ in range(40):
        scene.clock.advance(1 / 60)
    path = save_session(scene, start, tmp_path / "s.jsonl")
    return load_session(path, ball)


@pytest.fixture
def at_once(monkeypatch):
    """Nothing is played in full."""
    module = sys.modules[Hurry.__module__]
    monkeypatch.setattr(module, "PLAYING", 0.0)
    return module


def film_of(ball, session, playing, timeline):
    scene, first = Scene(ball, "ball", "cpu"), 0
    if timeline:
        session, first = with_timeline(playing(scene, session))
    film = Film(scene, session, 30, playing=playing)
    film.cut(first, None)
    return film


@pytest.mark.parametrize("timeline", [False, True])
def test_cameras_and_length_are_those_of_the_film(ball, session, at_once, timeline):
    hurry = Hurry()
    whole, quick = (film_of(ball, session, p, timeline) for p in (Player, hurry.player))
    assert quick.count == whole.count
    for frame in (whole.count // 4, whole.count // 2, whole.count - 1):
        whole.show(frame)
        quick.show(frame)
        for name in ("yaw", "pitch", "distance"):
            one, other = (getattr(f.orbit(f.tick(frame)), name) for f in (whole, quick))
            assert one == pytest.approx(other)
    passes = 2 if timeline else 1  # a timeline's session is played twice
    assert passes * 30 < hurry.left_out <= passes * whole.last


def test_a_short_session_is_played_in_full(ball, session):
    hurry = Hurry()
    whole, quick = (film_of(ball, session, p, False) for p in (Player, hurry.player))
    for film in (whole, quick):
        film.show(film.count - 1)
    assert np.array_equal(whole.scene.positions, quick.scene.positions)
    assert hurry.left_out == 0 and 0.0 < hurry.seconds and hurry.played > 20


def test_what_is_left_out_counts_as_what_was_played():
    hurry = Hurry()
    hurry.spent, hurry.editing, hurry.played, hurry.left_out = 2.0, 0.5, 100, 900
    assert hurry.seconds == pytest.approx(20.5)


def test_an_object_moves_for_some_seconds_after_an_edit(ball, session, at_once):
    scene, hurry = Scene(ball, "ball", "cpu"), Hurry()
    player = hurry.player(scene, session)
    player.play_to(session.ticks + 100_000)
    assert scene.journal.tick == session.ticks + 100_000
    assert hurry.left_out <= session.ticks + at_once.SETTLING


def test_a_pose_is_struck_in_little_time(ball, session, at_once):
    scene, hurry = Scene(ball, "ball", "cpu"), Hurry()
    Film(scene, None, 30, playing=hurry.player).strike(session.path)
    assert hurry.left_out > 30 and scene.handles.grabbed is None


# -- in the window -----------------------------------------------------------------------------


class Begun(SimpleNamespace):
    """A job that a test ends."""

    def stop(self):
        self.stopping = True


@pytest.fixture
def estimator(monkeypatch):
    """An Estimator, the jobs that it began, and its clock."""
    module = sys.modules[Estimator.__module__]
    clock, begun = [10.0], []
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])

    def begin(arguments):
        begun.append(
            Begun(arguments=arguments, stopping=False, ended=False, estimate=None, problem="")
        )
        return begun[-1]

    return Estimator(begin), begun, clock


def test_an_estimate_begins_when_the_choices_stand_still(estimator):
    one, begun, clock = estimator
    for size in ("a", "b", "c"):
        clock[0] += 0.4
        one.follow([size])
    assert not begun and one.line == "estimating ..."
    clock[0] += 0.6
    one.follow(["c"])
    one.follow(["c"])
    assert [job.arguments for job in begun] == [["c", "--estimate"]]
    begun[0].estimate = 723.0, 181
    begun[0].ended = True
    assert one.line == "about 12 min, 181 frames"


def test_an_estimate_of_other_choices_is_discarded(estimator):
    one, begun, clock = estimator
    one.follow(["a"])
    clock[0] += 1.0
    one.follow(["a"])
    one.follow(["b"])
    assert begun[0].stopping
    clock[0] += 1.0
    one.follow(["b"])
    assert len(begun) == 1 and one.line == "estimating ..."  # the first one still ends
    begun[0].estimate = 1.0, 1
    begun[0].ended = True
    assert one.line == "estimating ..."
    one.follow(["b"])
    assert len(begun) == 2 and not begun[1].stopping
    one.follow(None)
    assert begun[1].stopping and one.line == ""


def test_why_there_is_no_estimate_is_told(estimator):
    one, begun, clock = estimator
    one.follow(["a"])
    clock[0] += 1.0
    one.follow(["a"])
    begun[0].ended, begun[0].problem = True, "the memory is too small"
    assert one.line == "the memory is too small"
