"""Timelines in sessions: they play again to the bit, and damaged ones are refused."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from random_hands import use

from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.document import (
    Player,
    Scene,
    SessionError,
    load_session,
    save_session,
    start_of,
)
from deformrf.viewer.document.sessions.session import append_events
from deformrf.viewer.document.timeline import keys as k
from deformrf.viewer.films import Film


@pytest.fixture
def scene(ball):
    made = Scene(ball, "ball", "cpu")
    made.settings.grab_radius = 0.2
    return made


@pytest.fixture
def line(scene):
    return scene.timeline


def view(scene):
    return orbits.values_of(scene.orbit)


def vertices(scene):
    return scene.solver.vertices.numpy().copy()


class RandomTimeline:
    """Random edits of a timeline, with hands in between."""

    def __init__(self, scene, random):
        self.scene, self.random = scene, random
        self.line = scene.timeline

    def some_key(self):
        track = str(self.random.choice(["camera", "pose"]))
        keys = self.line.keys[track]
        return (track, int(self.random.choice([key.tick for key in keys]))) if keys else None

    def with_some(self, name, *values):
        at = self.some_key()
        if at is not None:
            getattr(self.line, name)(*at, *values)

    def tick(self):
        return int(self.random.integers(60))

    def turn(self):
        way = self.random.normal(scale=20.0, size=2)
        self.scene.orbit = orbits.turned(self.scene.orbit, *way, 240)

    def drag(self):
        if self.scene.handles.grabbed is None:
            self.scene.handles.grab(int(self.random.choice(self.scene.handles.control_ids)))
        else:
            self.scene.handles.drag_to(
                self.scene.handles.grabbed.target.place + self.random.normal(scale=0.05, size=3)
            )

    def blend(self):
        if self.line.poses:
            self.line.blend_pose(self.line.poses[0].name, float(self.random.uniform(-1.0, 1.0)))

    def edits(self):
        """All of them, likely ones several times."""
        scene, random, line = self.scene, self.random, self.line
        return (
            *(lambda: line.key(self.tick(), view(scene), bool(random.integers(4))),) * 3,
            *(line.play,) * 4,
            *(self.drag,) * 4,
            lambda: line.scrub(self.tick()),
            line.stop,
            lambda: self.with_some("move_key", self.tick()),
            lambda: self.with_some("copy_key", self.tick()),
            lambda: self.with_some("delete_key"),
            lambda: self.with_some("ease_key", str(random.choice(list(k.EASINGS)))),
            lambda: line.set_loop(bool(random.integers(2))),
            lambda: line.set_motion(str(random.choice(["interpolation", "physics"]))),
            lambda: line.turntable(int(random.integers(1, 90)), view(scene)),
            lambda: line.save_pose(str(random.choice(["a", "b"]))),
            self.blend,
            self.turn,
            lambda: setattr(scene.clock, "paused", bool(random.integers(3) == 0)),
            lambda: scene.handles.set_pin(
                int(random.integers(len(scene.positions))), bool(random.integers(2))
            ),
            lambda: scene.body.set_material(young_modulus=float(10.0 ** random.uniform(5, 7))),
            scene.handles.release,
            scene.reset,
            scene.undo,
            scene.redo,
            scene.clock.single_step,
        )


@pytest.mark.parametrize("trial", range(3))
def test_random_timelines_play_again_to_the_bit_and_undo_to_the_beginning(
    ball, scene, tmp_path, trial
):
    seed = int(np.random.default_rng().integers(2**32))
    random, start = np.random.default_rng(seed), start_of(scene)
    before, fresh = vertices(scene), scene.timeline.state()
    use(scene, random, RandomTimeline(scene, random).edits(), 120, most_frames=4)
    session = load_session(save_session(scene, start, tmp_path / "s.jsonl"), ball)
    other = Scene(ball, "ball", "cpu")
    player = Player(other, session)
    for tick in [*np.sort(random.integers(0, session.ticks + 1, 20)), session.ticks]:
        player.play_to(tick)
    np.testing.assert_array_equal(vertices(other), vertices(scene), f"seed {seed}")
    np.testing.assert_array_equal(other.solver.pinned, scene.solver.pinned, f"seed {seed}")
    assert asdict(other.orbit).items() >= {"yaw": scene.orbit.yaw}.items(), f"seed {seed}"
    assert other.timeline.head == scene.timeline.head, f"seed {seed}"
    assert other.journal.events == scene.journal.events, f"seed {seed}"
    while scene.journal.cursor:
        scene.undo()
    np.testing.assert_array_equal(vertices(scene), before, f"seed {seed}")
    np.testing.assert_array_equal(scene.solver.pinned, scene.pins, f"seed {seed}")
    assert scene.timeline.state() == fresh or not scene.journal.steps, f"seed {seed}"


def test_a_turntable_that_turns_for_long_records_next_to_nothing(ball, scene, line, tmp_path):
    """A film has its camera all the same: at ticks, between them, and where it was stopped."""
    start = start_of(scene)
    scene.clock.advance(0.1)
    line.turntable(88, view(scene))
    seen = {}
    for _ in range(40):
        scene.clock.advance(0.1)
        seen[scene.journal.tick] = scene.orbit
    line.stop()
    last = scene.journal.tick
    for _ in range(5):
        scene.clock.advance(0.1)
    names = [event.name for event in scene.journal.events]
    assert names == ["view", "turntable", "view", "stop"]
    session = load_session(save_session(scene, start, tmp_path / "s.jsonl"), ball)
    film = Film(Scene(ball, "ball", "cpu"), session, 25)
    for frame in range(film.count):
        film.show(frame)
        tick = film.tick(frame)
        angle = 2.0 * np.pi * (min(max(tick, 6.0), last) - 6.0) / 88.0
        turned = film.scene.orbit.yaw - seen[6 + 6].yaw + 2.0 * np.pi * 6.0 / 88.0
        assert np.cos(turned - angle) == pytest.approx(1.0, abs=1e-9)
    whole = Film(Scene(ball, "ball", "cpu"), session, 60)
    for tick, orbit in seen.items():
        whole.show(tick)
        assert view(whole.scene) == orbits.values_of(orbit)


def test_a_camera_that_stands_until_the_timeline_plays_stands_in_films(ball, scene, line, tmp_path):
    start = start_of(scene)
    line.key(0, orbits.values_of(replace(scene.orbit, yaw=2.0)), False)
    line.key(6, orbits.values_of(replace(scene.orbit, yaw=2.5)), False)
    scene.orbit = replace(scene.orbit, yaw=0.0)
    scene.clock.advance(0.1)
    line.play()
    scene.clock.advance(0.1)  # to the end, and
    scene.clock.advance(0.1)  # beyond
    session = load_session(save_session(scene, start, tmp_path / "s.jsonl"), ball)
    film = Film(Scene(ball, "ball", "cpu"), session, 60)
    yaws = []
    for frame in range(film.count):
        film.show(frame)
        yaws.append(film.scene.orbit.yaw)
    wanted = [line.orbit_at(max(tick - 6, 0)).yaw if tick >= 6 else 0.0 for tick in range(19)]
    np.testing.assert_array_equal(yaws, wanted[: len(yaws)])
    assert len(yaws) > 12 and not line.playing


def test_a_session_that_could_not_be_read_is_not_written(ball, scene, tmp_path, monkeypatch):
    start, path = start_of(scene), tmp_path / "s.jsonl"
    monkeypatch.setattr("deformrf.viewer.document.sessions.session.MOST_EVENTS", 4)
    for on in (True, False, True):
        scene.timeline.set_loop(on)
    load_session(save_session(scene, start, path), ball)
    before = path.read_bytes()
    scene.timeline.set_loop(False)
    for write in (
        lambda: save_session(scene, start, path),
        lambda: append_events(scene, path, 3),
    ):
        with pytest.raises(SessionError, match="4 events in 0 ticks, and 3 in"):
            write()
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "event",
    [
        [0, "key", {"tick": -1, "orbit": None, "pose": True}],
        [0, "key", {"tick": 0.5, "orbit": None, "pose": True}],
        [0, "key", {"tick": 10**9, "orbit": None, "pose": True}],
        [0, "key", {"tick": 0, "orbit": {}, "pose": True}],
        [0, "key", {"tick": 0, "orbit": {"yaw": "far"}, "pose": True}],
        [0, "key", {"tick": 0, "orbit": [0], "pose": 1}],
        [0, "move_key", {"track": "sound", "tick": 0, "to_tick": 0}],
        [0, "move_key", {"track": ["pose"], "tick": 0, "to_tick": 0}],
        [0, "ease_key", {"track": "pose", "tick": 0, "easing": ["smooth"]}],
        [0, "turntable", {"ticks": 0, "orbit": None}],
        [0, "set_motion", {"motion": "magic"}],
        [0, "save_pose", {"name": ""}],
        [0, "save_pose", {"name": "a\nb"}],
        [0, "save_pose", {"name": "a" * 10**6}],
        [0, "blend_pose", {"name": "a", "weight": 1e9}],
        [0, "scrub", {"tick": True}],
        [0, "play", {"tick": 0}],
    ],
)
def test_damaged_edits_of_a_timeline_are_refused(ball, scene, tmp_path, event):
    path = save_session(scene, start_of(scene), tmp_path / "s.jsonl")
    path.write_text(path.read_text() + json.dumps(event) + "\n")
    with pytest.raises(SessionError, match="line 2: "):
        load_session(path, ball)


def test_edits_of_keys_that_are_not_there_are_a_damaged_session(ball, scene, tmp_path):
    path = save_session(scene, start_of(scene), tmp_path / "s.jsonl")
    head = path.read_text()
    for event, told in (
        ('[0, "delete_key", {"track": "pose", "tick": 3}]', "no pose key at tick 3"),
        ('[0, "turntable", {"ticks": 3, "orbit": null}]', "no camera"),
    ):
        path.write_text(f"{head}{event}\n")
        with pytest.raises(SessionError, match=told):
            Player(scene, load_session(path, ball)).play_to(0)
