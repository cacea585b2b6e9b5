"""Sessions of any edits that the reader allows: a result, or one sentence."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from random_edits import random_events

from deformrf.viewer.document import (
    EDITS,
    Event,
    Patience,
    Player,
    Scene,
    Session,
    SessionError,
    load_session,
)
from deformrf.viewer.document.sessions import player
from deformrf.viewer.document.sessions.session import mesh_hash
from deformrf.wings import rig as rigs

DAY = 24 * 3600 * 60


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


@pytest.fixture
def rigged(ball):
    """A ball with two bones, a clip of bones and one of vertices."""
    scene = Scene(ball, "ball", "cpu")
    for height in (0.2, 0.5, 0.8):
        scene.rigging.add_joint(np.array([0.5, 0.5, height]))
    times, rig = np.arange(3) / 24.0, scene.rigging.rig
    frames = np.repeat(ball.mesh.rest_vertices[None].astype(np.float32), 3, axis=0)
    clips = (
        rigs.VertexClip("Run", times, frames),
        rigs.clip_of_poses("a", times, [rig.skeleton.rest_pose] * 3),
    )
    return replace(ball, rig_arrays=rigs.arrays_of(replace(rig, clips=clips)))


def write(path, field, events, ticks=50):
    mesh = field.mesh
    header = {"deformrf session": 1, "model": "x", "rest": mesh_hash(mesh), "ticks": ticks}
    lines = [header | {"vertices": mesh.vertex_count, "tets": mesh.tet_count, "start": {}}, *events]
    path.write_text("\n".join(map(json.dumps, lines)) + "\n")
    return path


@pytest.mark.parametrize("with_rig", [False, True])
def test_whatever_the_reader_allows_is_played_or_refused_in_a_sentence(
    ball, rigged, tmp_path, with_rig
):
    """What is refused is left out, so that the edits behind it are tried as well."""
    field = rigged if with_rig else ball
    scene, mesh = Scene(field, "x", "cpu"), field.mesh
    tried, seed = set(), int(np.random.default_rng().integers(2**32))
    rng = np.random.default_rng(seed)
    for _ in range(8):
        events = random_events(rng, mesh.vertex_count, mesh.tet_count, 40, 40)
        tried |= {event[1] for event in events}
        while True:
            path = write(tmp_path / "s.jsonl", field, events)
            scene.states.begin_anew()
            try:
                Player(scene, load_session(path, field)).play_to(50)
                break
            except SessionError as error:
                message, cause = str(error), error.__cause__
            assert isinstance(cause, ValueError), f"seed {seed}: {message} {cause!r}"
            assert "\n" not in message and len(message) < 500, f"seed {seed}: {message}"
            number = int(message.removeprefix(f"{path}, line ").split(":")[0])
            at, name, _ = events.pop(number - 2)
            assert f"line {number}: {name} at tick {at} can't be played: " in message
        assert np.isfinite(scene.solver.vertices.numpy()).all(), f"seed {seed}"
    assert len(tried) > 0.8 * len(EDITS)


@pytest.mark.parametrize(
    "event, told",
    [
        ([0, "rest_bones", {"bones": []}], "there are no bones"),
        ([0, "rest_bones", {"bones": [2]}], "there is no bone 2"),
        ([0, "turn_bones", {"bones": [], "rotations": [[0, 0, 0, 1]]}], "0 bones have 1 rotations"),
    ],
)
def test_edits_that_the_model_cant_take_name_their_line(ball, scene, tmp_path, event, told):
    path = write(tmp_path / "s.jsonl", ball, [[0, "set_ground", {"height": 0.0}], event])
    with pytest.raises(SessionError, match=rf"s\.jsonl, line 3: .* at tick 0 .*: {told}"):
        Player(scene, load_session(path, ball)).play_to(50)


def test_a_fault_of_the_program_is_a_sentence_and_stays_in_the_log(ball, scene, caplog):
    def broken(*arguments):
        raise KeyError("nobody thought of this")

    scene.body.set_gravity = broken
    session = Session({"start": {}, "ticks": 9}, [Event(4, "set_gravity", {"strength": 1.0})])
    caplog.set_level("INFO")
    with pytest.raises(SessionError, match=r"the session, line 2: set_gravity at tick 4 .* KeyE"):
        Player(scene, session).play_to(9)
    assert "broken" in caplog.text and "Traceback" in caplog.text


def test_time_in_which_nothing_moves_takes_no_time(scene):
    """Each of a day's ticks took some microseconds: minutes without a word."""
    events = [Event(7, "set_ground", {"height": 0.0}), Event(DAY - 5, "hold", {"held": False})]
    ticks, tick = [], scene.clock.tick
    scene.clock.tick = lambda: (ticks.append(scene.journal.tick), tick())
    playing = Player(scene, Session({"start": {}, "ticks": DAY}, events))
    assert playing.play_to(3) and scene.journal.tick == 3
    assert playing.play_to(DAY) and scene.journal.tick == DAY
    assert scene.journal.events == events
    assert len(ticks) < 5000  # until it has come to rest on the ground


def test_playing_can_stop_between_any_two_steps(scene, monkeypatch):
    events = [Event(2, "set_gravity", {"strength": 3.0})] * 3
    monkeypatch.setattr(player, "BATCH_SECONDS", 0.0)
    playing = Player(scene, Session({"start": {}, "ticks": 9}, events))
    assert list(playing.batches(9)) == [2, 2, 2, 2, 3, 4, 5, 6, 7, 8, 9]


class Terminal:
    def __init__(self, answer):
        self.answer = answer

    def isatty(self):
        return self.answer is not None

    def readline(self):
        return self.answer


@pytest.mark.parametrize("answer, goes_on", [("y\n", True), ("\n", False), (None, True)])
def test_a_command_asks_before_hours_and_without_a_terminal_says_so(
    monkeypatch, capsys, answer, goes_on
):
    monkeypatch.setattr(player, "SURE_SECONDS", 0.0)
    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: answer is not None)
    patience = Patience("rendering", 10**9)
    patience._since -= 10.0
    if goes_on:
        patience.heed(1000)
        patience.heed(1000)  # asks once
    else:
        with pytest.raises(KeyboardInterrupt):
            patience.heed(1000)
    said = capsys.readouterr().err
    assert said.count("rendering takes about 2778 h more") == 1
    assert ("Ctrl-C ends it" in said) == (answer is None)
