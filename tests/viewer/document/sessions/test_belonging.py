"""A session opens together with what was saved with it: its model, or a copy made on its way."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from deformrf.core import field as fields
from deformrf.core.base.paths import BUNDLED, DEFAULT_MODEL
from deformrf.viewer.actions import ACTIONS
from deformrf.viewer.document import (
    Player,
    Scene,
    SessionError,
    open_session,
    save_session,
    start_of,
)
from deformrf.wings import rig as rigs

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    """An App that shows a ball's file, models/ball.npz, and writes into work/."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    for name in ("models", "work"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "work")
    fields.save(ball, tmp_path / "models" / "ball.npz")
    made = App(*window, EventLog(False), gui=False)
    made.load(fields.load(tmp_path / "models" / "ball.npz"), "ball", "cpu")
    made.scene.source = tmp_path / "models" / "ball.npz"
    yield made
    made.close()


def rig(app):
    for height in (0.2, 0.5, 0.8):
        app.scene.rigging.add_joint(np.array([0.5, 0.5, height]))


def paint(app):
    app.scene.paint(app.scene.positions[3], 3.0)


def cut(app):
    masks = np.zeros(app.scene.field.mesh.tet_count, np.uint64)
    masks[:40] = np.uint64(2**64 - 1)
    app.scene.cuts.delete(masks)


def pose(app):
    if app.scene.rigging.bone_count:
        app.scene.posing.set_softness(0.5)
        app.scene.posing.hold_bone(1)
        app.scene.posing.turn_bones([1], [[0.0, 0.6, 0.0, 0.8]])
    app.scene.set_gravity(3.0)


def saved(app):
    """What was saved last: the file."""
    return app.recorder.written[-1]


def work(app, edits, copies=True):
    """Edit, save a copy, go on, save the session; both paths."""
    for edit in edits:
        edit(app)
    app.scene.clock.advance(0.1)
    ACTIONS["save_model"](app)
    copy = saved(app)
    pose(app)
    for _ in range(3):
        app.scene.clock.advance(0.1)
    ACTIONS["save_session"](app)
    return copy, saved(app)


def assert_plays_to(app, opened):
    """In a new scene a session ends as the App's scene is, with all that was done."""
    scene = Scene(opened.field, "other", "cpu")
    Player(scene, opened.session).play_to(opened.session.ticks)
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), app.scene.solver.vertices.numpy())
    np.testing.assert_array_equal(scene.cuts.removed, app.scene.cuts.removed)
    assert scene.rigging.bone_count == app.scene.rigging.bone_count
    assert scene.journal.events == app.scene.journal.events


EDITS = {"rig": [rig], "stiffness": [paint], "both": [rig, paint], "all": [rig, paint, cut]}


@pytest.mark.parametrize("edits", EDITS.values(), ids=EDITS)
def test_a_copy_and_the_session_open_together(app, edits):
    copy, session = work(app, edits)
    opened = open_session(session, fields.load(copy), copy)
    assert opened.source == app.scene.source.parent.parent / "work/../models/ball.npz"
    assert "began with ball.npz" in opened.said
    assert_plays_to(app, opened)


def test_in_the_window_the_session_s_model_is_shown(app):
    copy, session = work(app, [rig, cut])
    expected = app.scene.solver.vertices.numpy().copy()
    app.opening.asked = copy
    app.frame(0.0)
    assert app.scene.name == copy.stem and app.scene.field.mesh.tet_count
    app.opening.asked = session
    app.frame(0.0)
    assert app.questions.dialog is None, app.questions.dialog
    assert app.scene.name == "ball" and app.scene.rigging.bone_count == 2
    np.testing.assert_array_equal(app.scene.solver.vertices.numpy(), expected)
    ACTIONS["save_session"](app)  # again, from here
    assert json.loads(saved(app).open().readline())["file"] == "../models/ball.npz"


def test_they_open_together_after_they_were_moved(app, tmp_path):
    copy, session = work(app, [rig, cut])
    moved = tmp_path / "elsewhere" / "deep"
    moved.mkdir(parents=True)
    both = [shutil.copy(path, moved / path.name) for path in (app.scene.source, session)]
    shutil.rmtree(tmp_path / "models")
    session.unlink()
    bundled = fields.load(DEFAULT_MODEL)  # what the commands take if no model is given
    assert_plays_to(app, open_session(both[1], bundled, DEFAULT_MODEL))
    model = shutil.move(both[0], tmp_path / "work" / "ball.npz")
    assert_plays_to(app, open_session(both[1], fields.load(copy), tmp_path / "work" / copy.name))
    assert model.exists()


@pytest.mark.parametrize("edits", [[rig], [paint], [rig, paint]])
def test_a_copy_of_the_same_mesh_is_enough(app, tmp_path, edits):
    """It is taken without the rig and the stiffnesses that it had not yet at the beginning."""
    copy, session = work(app, edits)
    shutil.rmtree(tmp_path / "models")
    opened = open_session(session, fields.load(copy), copy)
    assert "began before the model had" in opened.said
    assert_plays_to(app, opened)


def test_without_its_model_a_session_says_which_one_it_wants(app, tmp_path):
    copy, session = work(app, [rig, cut])
    renamed = app.scene.source.rename(tmp_path / "models" / "renamed.npz")
    for at_hand in (copy, DEFAULT_MODEL):
        with pytest.raises(SessionError, match=rf"{at_hand.name}.*began with \.\./models/ball.npz"):
            open_session(session, fields.load(at_hand), at_hand)
    assert_plays_to(app, open_session(session, fields.load(renamed), renamed))


def test_a_copy_of_a_model_with_a_rig_has_the_same_rig(app, ball):
    """Unless it was changed: arrays that are written anew differ in the last bits."""
    rig(app)
    arrays = rigs.arrays_of(app.scene.rigging.rig)
    arrays["rig_weights"] = arrays["rig_weights"] * np.float32(1.0 + 3e-7)
    app.load(replace(ball, rig_arrays=arrays), "rigged", "cpu")
    copy, session = work(app, [])
    opened = open_session(session, fields.load(copy), copy)
    assert opened.said == "" and opened.source == copy
    assert_plays_to(app, opened)


@pytest.mark.parametrize("name", ["/etc/a.npz", "C:\\a.npz", "a\nb.npz", "a.txt", "", 7, ["a.npz"]])
def test_names_that_no_session_writes_lead_nowhere(app, tmp_path, name):
    path = save_session(app.scene, start_of(app.scene), tmp_path / "work" / "s.jsonl")
    header = json.loads(path.read_text())
    path.write_text(json.dumps(header | {"file": name, "rest": "another"}) + "\n")
    with pytest.raises(SessionError, match="a session of another model") as caught:
        open_session(path, app.scene.field, app.scene.source)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 600


def test_the_bundled_model_is_named_by_no_path(app, tmp_path):
    app.scene.source = DEFAULT_MODEL
    path = save_session(app.scene, start_of(app.scene), tmp_path / "s.jsonl")
    assert json.loads(path.read_text())["file"] is None


@pytest.mark.parametrize("name", BUNDLED)
def test_a_session_of_a_bundled_model_finds_it_anywhere(app, tmp_path, name):
    app.load(fields.load(BUNDLED[name]), name, "cpu")
    app.scene.source = BUNDLED[name]
    pose(app)
    ACTIONS["save_session"](app)
    path = saved(app)
    assert json.loads(path.open().readline())["file"] is None
    for at_hand in BUNDLED.values():
        opened = open_session(path, fields.load(at_hand), at_hand)
        assert opened.source == BUNDLED[name]
        assert_plays_to(app, opened)
