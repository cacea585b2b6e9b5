"""What can't be written never keeps the rest of a session from being written."""

import math

import numpy as np
import pytest

from deformrf.viewer.document import Event, Player, Scene, load_session, save_session, start_of
from deformrf.viewer.document.sessions import autosave as a


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


BAD = {  # what an older journal, or a program, may have: name and arguments
    "material": ("set_material", {"young_modulus": math.nan}),
    "infinite": ("set_material", {"density": math.inf}),
    "range": ("set_material", {"young_modulus": 1e30}),
    "gravity": ("set_gravity", {"strength": -math.inf}),
    "move": ("move", {"to": [0.0, math.nan, 0.0]}),
    "far": ("move", {"to": [0.0, 1e9, 0.0]}),
    "key": ("key", {"tick": 3, "orbit": {"yaw": math.nan}, "pose": True}),
    "vertex": ("grab", {"vertex": 10**9, "radius": 0.1, "soft": False}),
    "view": ("view", {"yaw": math.nan}),
    "kind": ("set_wind", {"speed": object()}),
    "unknown": ("no_such_edit", {"x": 1}),
    "name": ("name", {"vertex": 1, "text": "a\nb"}),
}


@pytest.mark.parametrize("bad", BAD)
def test_all_the_rest_is_saved_and_what_is_left_out_is_told(scene, ball, tmp_path, bad):
    scene.set_ground(True)
    scene.journal.events.append(Event(scene.journal.tick, *BAD[bad]))
    scene.set_gravity(2.0)
    told = []
    path = save_session(scene, start_of(scene), tmp_path / "s.jsonl", told.append)
    events = load_session(path, ball).events
    assert [event.name for event in events] == ["set_ground", "set_gravity"]
    (sentence,) = told
    assert BAD[bad][0] in sentence and "left out" in sentence and len(sentence) < 200


def test_of_values_that_stand_alone_the_others_stay(scene, ball, tmp_path):
    values = {"young_modulus": math.nan, "damping": 4.0, "yield_strain": math.inf}
    scene.journal.events.append(Event(0, "set_material", values))
    scene.journal.events.append(Event(0, "view", {"mesh_opacity": math.inf, "yaw": 0.5}))
    path = save_session(scene, start_of(scene), tmp_path / "s.jsonl", lambda told: None)
    events = load_session(path, ball).events
    assert events[0].arguments == {"damping": 4.0, "yield_strain": None}
    assert events[1].arguments == {"yaw": 0.5}


def test_a_start_that_cant_be_written_is_the_models_own(scene, ball, tmp_path):
    told, start = [], start_of(scene) | {"floor": math.nan, "density": math.inf}
    path = save_session(scene, start, tmp_path / "s.jsonl", told.append)
    session = load_session(path, ball)
    assert "floor" not in session.header["start"] and "density" not in session.header["start"]
    assert "floor = nan" in told[0]
    other = Scene(ball, "ball", "cpu")
    Player(other, session).play_to(0)
    assert other.floor == scene.floor


def test_a_sentence_about_many_is_short(scene, tmp_path):
    for _ in range(5000):
        scene.journal.events.append(Event(0, "move", {"to": [math.nan] * 3}))
    told = []
    save_session(scene, start_of(scene), tmp_path / "s.jsonl", told.append)
    assert len(told) == 1 and len(told[0]) < 300 and "4997 more" in told[0]


def test_the_autosave_goes_on(scene, ball, tmp_path):
    """Written at once, and when it grows; each says what it lacks, once."""
    now = [0.0]
    kept = a.Autosave(scene, start_of(scene), tmp_path, lambda: now[0])
    said = []
    for step in range(4):
        scene.set_ground(step % 2 == 0)
        if step < 2:
            scene.journal.events.append(Event(scene.journal.tick, *BAD["move"]))
        now[0] += 1000.0
        said.append(kept.update())
        assert not kept.failed
    assert ["left out" in sentence for sentence in said] == [True, True, False, False]
    assert [event.name for event in load_session(kept.path, ball).events] == 4 * ["set_ground"]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_edits_refuse_what_is_no_number(scene, value):
    scene.set_ground(True)
    before, count = scene.body.material, len(scene.journal.events)
    orbit = {"target": [0.0, value, 0.0]}
    for act in (
        lambda: scene.body.set_material(young_modulus=value),
        lambda: scene.set_gravity(value),
        lambda: scene.body.set_wind(np.float32(value)),
        lambda: scene.handles._move([0.0, 0.0, value]),
        lambda: scene.handles._grab(1, value, False),
        lambda: scene.timeline.key(0, orbit, True),
        lambda: scene.rigging.begin_chain(np.array([value, 0.0, 0.0])),
        lambda: scene.posing.set_softness(value),
    ):
        with pytest.raises(ValueError, match="can't have"):
            act()
    assert scene.body.material == before and len(scene.journal.events) == count
    assert scene.handles.grabbed is None and len(scene.journal.steps) == 1
    scene.body.set_material(yield_strain=math.inf)  # never


def test_a_drag_to_nowhere_stays_where_it_is(scene):
    """As from a camera that isn't anywhere; the viewer goes on."""
    scene.handles.grab(int(scene.handles.control_ids[0]))
    place = scene.handles.grabbed.reached.place.copy()
    scene.handles.drag_to(np.array([math.nan, 0.0, 0.0]))
    scene.clock.advance(0.1)
    assert np.array_equal(scene.handles.grabbed.reached.place, place)
    scene.handles.drag_to(place + 0.01)
    scene.clock.advance(0.1)
    assert np.allclose(scene.handles.grabbed.reached.place, place + 0.01)
    scene.handles.release()
    scene.push(place, np.array([0.0, 0.0, 1.0]))
    scene.push_to(np.full(3, math.inf))
    scene.clock.advance(0.1)
    assert np.isfinite(scene.ball.reached).all()
