"""Sessions that are played in the window: they can be stopped, and delete nothing."""

from dataclasses import asdict

import numpy as np
import pytest

from deformrf.viewer.document import Event, Session, load_project, load_session, save_session
from deformrf.viewer.document.sessions import autosave as a

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    """An App with panels in a window without a display, showing a ball on the ground."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))  # sessions that are kept
    made = App(*window, EventLog(False))
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.25
    made.scene.set_ground(True)
    made.run(2)
    yield made
    made.close()


def test_an_earlier_integrator_is_told_of(app, bent):
    header, *events = bent.read_text().splitlines()
    bent.write_text("\n".join([header.replace('"extrapolated"', '"euler"'), *events]))
    for path in (bent, save_session(app.scene, app.session_start, bent.with_name("new.jsonl"))):
        app.opening.asked = path
        app.frame(0.0)
        assert (app.scene.solver.options.integrator == "euler") == (path == bent)
        assert ("(euler)" in app.recorder.message) == (path == bent), app.recorder.message


@pytest.fixture
def bent(app, tmp_path):
    """The file of a session in which gravity was set."""
    app.scene.set_gravity(3.0)
    path = save_session(app.scene, app.session_start, tmp_path / "bent.jsonl")
    app.scene.undo()
    return path


@pytest.mark.parametrize("how", ["Esc", "close"])
def test_a_session_of_a_day_can_be_stopped(app, monkeypatch, how):
    """A file of a few lines may say that it is so long."""
    from pyglet.window import key

    from deformrf.viewer import playing

    shown = []

    def draw(*at):
        shown.append(at)
        assert len(shown) < 9, "it goes on"
        pressed = ("on_key_press", key.ESCAPE, 0) if how == "Esc" else ("on_close",)
        app.window.dispatch_event(*pressed)

    monkeypatch.setattr(playing, "SILENT_SECONDS", 0.0)
    monkeypatch.setattr(app.panels, "playing_window", draw)
    scene = app.scene
    events, orbit, pose = list(scene.journal.events), scene.orbit, scene.positions.copy()
    turning = Event(0, "turntable", {"ticks": 60, "orbit": asdict(orbit)})
    day = Session({"start": {}, "ticks": 24 * 3600 * 60}, [turning])
    assert not app.playing.play(day) and app.closing == (how == "close")
    assert scene.journal.events == events and scene.orbit == orbit and scene.on_ground
    np.testing.assert_allclose(scene.positions, pose, atol=1e-6)
    assert "stopped" in app.recorder.message
    app.run(app.frame_count + 1)
    assert (app.questions.leaving is not None) == (how == "close") and not app.window.has_exit
    assert scene.undo()


@pytest.mark.parametrize("answer", ["enter", "escape"])
def test_what_takes_hours_is_asked_about(app, monkeypatch, answer):
    from pyglet.window import key

    from deformrf.viewer.document.sessions import player

    monkeypatch.setattr(player, "SURE_SECONDS", 0.0)
    monkeypatch.setattr(player, "LONG", 0.0)
    monkeypatch.setattr(player, "BATCH_SECONDS", 0.0)
    asked, draw = [], app.panels.playing_window

    def ask(tick, patience):
        draw(tick, patience)
        asked.append((tick, patience.asks(tick)))
        if len(asked) == 3:
            app.window.dispatch_event("on_key_press", getattr(key, answer.upper()), 0)

    monkeypatch.setattr(app.panels, "playing_window", ask)
    turning = Event(0, "turntable", {"ticks": 60, "orbit": asdict(app.scene.orbit)})
    before = app.scene.journal.tick
    played = app.playing.play(Session({"start": {}, "ticks": 50}, [turning]))
    assert played == (answer == "enter")
    assert asked[:3] == [(asked[0][0], True)] * 3  # nothing is played meanwhile
    assert app.scene.journal.tick == (50 if played else before)


def test_a_day_in_which_nothing_moves_is_played_at_once(app):
    events = [(5, "set_ground", {"height": 0.0}), (24 * 3600 * 60 - 3, "hold", {"held": False})]
    day = Session({"start": {}, "ticks": 24 * 3600 * 60}, [Event(*one) for one in events])
    assert app.playing.play(day) and app.scene.journal.tick == day.ticks
    assert app.scene.journal.events[:2] == day.events


def test_what_was_done_before_is_kept_and_offered_later(app, ball, bent):
    kept = app.autosave.path
    app.opening.asked = bent
    app.frame(0.0)
    assert app.scene.body.gravity == 3.0
    assert "played bent.jsonl" in app.recorder.message and "is kept" in app.recorder.message
    names = [event.name for event in load_session(kept, ball).events]
    assert "set_ground" in names
    app.end()
    assert not app.autosave.path.exists()
    assert a.left_behind(a.autosave_folder(), ball.mesh) == kept


def test_what_was_left_behind_stays_until_the_new_file_is_written(app, bent, monkeypatch):
    def fail(*arguments):
        raise OSError(28, "No space left on device")

    app.questions.left_behind = bent
    with monkeypatch.context() as full:
        full.setattr(a, "save_session", fail)
        app.playing.recover()
    assert app.scene.body.gravity == 3.0 and bent.exists()
    assert "can't be kept" in app.recorder.message
    kept = app.autosave.path
    app.questions.left_behind = bent
    app.playing.recover()
    assert not bent.exists() and app.autosave.path.exists() and kept.exists()


def test_windows_in_the_middle_come_one_after_another(app, bent, monkeypatch):
    """The question about the session that was left behind is the first."""
    from imgui_bundle import imgui

    from deformrf.viewer.files import Problem

    drawn = []

    def noted(begin):
        return lambda name, *arguments, **named: (
            drawn.append(name) or begin(name, *arguments, **named)
        )

    for name in ("begin", "begin_popup_modal"):
        monkeypatch.setattr(imgui, name, noted(getattr(imgui, name)))
    app.questions.left_behind, app.questions.dialog = bent, Problem("a", "b")
    app.takes.ask()
    app.scene.settings.show_help = True
    for name in ("recovery", "dialog", "film", "help"):
        drawn.clear()
        app.frame(0.0)
        assert [n for n in drawn if n in ("recovery", "dialog", "film", "help")] == [name]
        if name == "recovery":
            app.questions.left_behind = None
        elif name == "dialog":
            app.questions.dialog = None
        app.takes.asking &= name != "film"


# -- projects ----------------------------------------------------------------------------------


@pytest.fixture
def work(app, tmp_path):
    """A project that the App has saved, in which gravity bends the ball."""
    app.scene.set_gravity(3.0)
    app.run(app.frame_count + 3)
    app.scene.settings.gizmo, app.scene.settings.mode = "turn", "depth"
    path = tmp_path / "work.deformrf"
    assert app.save_project(path) == ""
    return path


def open_file(app, path):
    app.opening.asked = path
    app.frame(0.0)
    assert app.questions.dialog is None, app.questions.dialog


def test_a_project_that_is_saved_is_open_and_nothing_is_unsaved(app, work):
    assert app.project == app.scene.source == work and app.recorder.written == [work]
    assert not app.scene.journal.unsaved and not app.autosave.path.exists()
    app.scene.set_gravity(1.0)
    assert app.scene.journal.unsaved
    assert app.save_project() == "" and app.recorder.written[-1] == work
    assert load_project(work).session.events[-1].arguments == {"strength": 1.0}


def test_a_project_opens_as_it_was_saved_and_undo_goes_on(app, work, tmp_path):
    saved = app.scene.solver.vertices.numpy().copy()
    moved = work.rename(tmp_path / "moved.deformrf")
    app.load(app.scene.field, "ball", "cpu")
    assert app.project is None
    app.scene.settings.gizmo, app.scene.settings.mode = "move", "color"
    open_file(app, moved)
    np.testing.assert_array_equal(app.scene.solver.vertices.numpy(), saved)
    assert app.project == app.scene.source == moved and app.scene.name == "moved"
    assert (app.scene.settings.gizmo, app.scene.settings.mode) == ("turn", "depth")
    assert app.preferences.recent == [str(moved), str(work)]
    assert "opened moved" in app.recorder.message
    assert not app.scene.journal.unsaved
    assert app.scene.undo() and app.scene.body.gravity != 3.0 and app.scene.on_ground
    assert app.save_project() == "" and not work.exists()


def test_time_that_is_stopped_stays_stopped(app, tmp_path):
    app.scene.set_gravity(3.0)
    app.run(app.frame_count + 2)
    app.scene.clock.paused = True
    app.save_project(tmp_path / "work.deformrf")
    saved = app.scene.solver.vertices.numpy().copy()
    open_file(app, tmp_path / "work.deformrf")
    app.frame(0.1)
    assert app.scene.clock.paused
    np.testing.assert_array_equal(app.scene.solver.vertices.numpy(), saved)


def test_another_file_closes_the_project(app, work, bent, monkeypatch):
    """Else saving would replace it by something else."""
    open_file(app, work)
    open_file(app, bent)
    assert app.project is None
    open_file(app, work)
    app.questions.left_behind = bent
    app.playing.recover()
    assert app.project is None
    open_file(app, work)
    monkeypatch.setattr("deformrf.viewer.playing.Playing._play", stop)
    open_file(app, work)
    assert app.project is None and "stopped" in app.recorder.message


def stop(*arguments):
    from deformrf.viewer import playing

    raise playing._Stopped


def test_a_project_that_cant_be_saved_is_told_of(app, work, tmp_path):
    app.scene.set_gravity(1.0)
    (tmp_path / "folder.deformrf").mkdir()
    for path, words in (("folder.deformrf", "a folder, not a file"), ("a.zip", "has to end in")):
        assert words in app.save_project(tmp_path / path)
    assert app.project == work and app.scene.journal.unsaved


def test_without_a_name_a_project_goes_where_dialogs_begin(app, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "ball.deformrf").touch()
    assert app.save_project() == "" and app.project == tmp_path / "ball-2.deformrf"


def test_a_damaged_project_keeps_the_scene(app, work):
    scene = app.scene
    work.write_bytes(work.read_bytes()[:2000])
    app.opening.asked = work
    app.frame(0.0)
    assert app.scene is scene and "is not a project" in app.questions.dialog.sentence
