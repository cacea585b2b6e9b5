"""Sessions that are played to their end: damaged ones, and ones of random edits that are allowed.

What was played is saved and read again, as the autosave does.  Films of a part of a session look
at some of its frames.
"""

import json
import math
import time
from dataclasses import replace

import numpy as np
from random_edits import random_events

from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.core.field import load
from deformrf.viewer.document import (
    Player,
    Scene,
    SessionError,
    left_behind,
    load_session,
    save_session,
    start_of,
)
from deformrf.viewer.films import Film, with_timeline

from .damage import with_text, with_values
from .models import small_models

MOST_TICKS = 120  # of sessions that are made here
MOST_EDITS = 25
PATIENCE = 1.0  # s of processor time for a session that lasts longer
REPLAYS = 12  # of a session without the edits that the model can't take
FILMED = 1000  # ticks, at most
LONG = 5_184_000, 3_000_000, 100_000  # ticks: a day, and less


class Sessions:
    """One JSON value a line; those of random edits are valid."""

    errors = (SessionError,)
    tells_all = True  # errors of any kind, as sentences

    def __init__(self, folder):
        paths = [*small_models(folder), *([DEFAULT_MODEL] if DEFAULT_MODEL.is_file() else [])]
        self.fields = {f"{i}.jsonl": load(path) for i, path in enumerate(paths)}
        self.lines = {}
        for name, field in self.fields.items():
            scene = Scene(field, "small", "cpu")
            self.lines[name] = _lines(_used(scene), folder / name)

    def original(self, folder):
        self._write(folder, "1.jsonl", self.lines["1.jsonl"])

    def mutate(self, rng, folder):
        name = list(self.fields)[min(int(rng.integers(9)) // 4, len(self.fields) - 1)]
        lines, kind = self.lines[name], int(rng.integers(10))
        if kind <= 6:
            mesh, count = self.fields[name].mesh, int(rng.integers(1, MOST_EDITS))
            events = random_events(rng, mesh.vertex_count, mesh.tet_count, count, MOST_TICKS)
            lines = [dict(lines[0]), *events]
            lines[0]["ticks"] = int(rng.choice([0, events[-1][0], MOST_TICKS]))
            if kind == 0:
                lines[0]["ticks"] = int(rng.choice(LONG))
            if rng.random() < 0.1:
                lines[0]["start"] = with_values(rng, lines[0]["start"] or {"pins": []})
            what = "allowed edits: " + ", ".join(line[1] for line in lines[1:])
        elif kind == 7:
            lines, what = with_values(rng, lines), "values"
        else:
            data, what = with_text(rng, "\n".join(map(json.dumps, lines)) + "\n")
            (folder / name).write_bytes(data)
            return what
        self._write(folder, name, lines)
        return what

    def _write(self, folder, name, lines):
        text = "\n".join(map(json.dumps, lines)) + "\n"
        (folder / name).write_text(text, encoding="utf-8")

    def read(self, folder):
        path = next(folder.glob("*.jsonl"))
        field = self.fields[path.name]
        session = load_session(path, field)
        scene = played(field, session)
        assert np.isfinite(scene.positions).all(), "positions are not finite"
        start = start_of(Scene(field, "small", "cpu")) | session.header["start"]
        saved = save_session(scene, start, folder / "saved.jsonl")
        assert load_session(saved, field).ticks == scene.journal.tick, "another length"


def played(field, session):
    """A scene in which a session was played; an edit that is refused is left out of the next try.

    As in the window, it is played in batches, and a refusal leaves the scene as it was.  A user
    could end what takes long: here that is after PATIENCE.

    Raises:
        SessionError: Its start is refused, or too many edits are.
    """
    scene, begin = Scene(field, "small", "cpu"), time.process_time()
    for tries in range(REPLAYS):
        made = 0
        try:
            with scene.states.unless_it_fails():
                scene.states.begin_anew()
                player = Player(scene, session)
                try:
                    for _ in player.batches(session.ticks):
                        if time.process_time() - begin > PATIENCE:
                            break
                finally:
                    made = player._made
            return scene
        except SessionError:
            if not made or tries == REPLAYS - 1 or time.process_time() - begin > PATIENCE:
                raise
            events = session.events[: made - 1] + session.events[made:]
            session = replace(session, events=events)


class Autosaves(Sessions):
    """A session that was left behind: its last line may be cut."""

    def read(self, folder):
        path = next(folder.glob("*.jsonl"))
        field = self.fields[path.name]
        left_behind(folder, field.mesh)
        played(field, load_session(path, field, whole=False))


class Takes(Sessions):
    """Films of a part of a session, or of its timeline: some of their frames."""

    errors = (SessionError, ValueError)  # of a part that there isn't

    def read(self, folder):
        path = next(folder.glob("*.jsonl"))
        field = self.fields[path.name]
        session = load_session(path, field)
        if max(session.ticks, *_ticks(session)) > FILMED:
            return  # it may take as long as it likes
        scene = Scene(field, "small", "cpu")
        begin, rng = 0, np.random.default_rng(len(session.events))
        if any(event.name == "key" for event in session.events):
            session, begin = with_timeline(Player(scene, session))
        film = Film(scene, session, int(rng.choice([15, 30, 60])))
        first = int(rng.integers(-1, max(session.ticks - begin, 1)))
        film.cut(begin + max(first, 0), None if first < 0 else begin + first + 10)
        for frame in range(min(film.count, 4)):
            film.show(frame)
            for camera, vertices in film.moments(frame, (8, 8), 2, 0.5):
                assert np.isfinite(camera.camera_to_world).all(), "a camera is not finite"
                assert vertices is None or np.isfinite(vertices).all(), "not finite"
        assert math.isfinite(film.tick(0))


def _ticks(session):
    """All ticks that edits name, of keys and turns."""
    yield 0
    for event in session.events:
        yield from (value for key, value in event.arguments.items() if "tick" in key)


def _used(scene):
    """A scene that a hand has used, and its start."""
    start = start_of(scene)
    vertex = int(np.flatnonzero(~scene.pins)[0])
    scene.handles.set_pin(vertex, True)
    scene.clock.advance(1 / 30)
    scene.handles.set_pin(vertex, False)
    scene.settings.grab_radius = 0.2
    scene.handles.grab(int(scene.handles.control_ids[0]))
    for _ in range(3):
        scene.clock.advance(1 / 30)
        scene.handles.drag_to(scene.handles.grabbed.target.place + 0.01)
    scene.handles.release()
    scene.paint(np.full(3, 0.5), 1.2)
    return scene, start


def _lines(used, path):
    scene, start = used
    text = save_session(scene, start, path).read_text(encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]
