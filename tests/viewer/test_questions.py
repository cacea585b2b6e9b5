"""What is asked before the end, and what is lost, stopped or kept then."""

import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from asking_app import click, frames, opened, places_of_buttons, press, quit_by, send

from deformrf.viewer.document import (
    autosave_folder,
    left_behind,
    load_project,
    save_session,
)
from deformrf.viewer.films import FilmChoices

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    with opened(window, ball, monkeypatch, tmp_path) as made:
        yield made


@pytest.fixture
def places(monkeypatch):
    return places_of_buttons(monkeypatch)


@pytest.fixture
def worked(app):
    """The App after an edit that the autosave has."""
    app.scene.set_ground(True)
    app.autosave.save()
    return app


HOW = pytest.mark.parametrize("how", ["key", "menu", "close"])


@HOW
def test_without_work_nothing_is_asked(app, how):
    app.scene.set_ground(True)
    assert app.scene.undo()  # back to where it began
    quit_by(app, how)
    assert app.window.has_exit and app.questions.leaving is None


@HOW
def test_work_is_asked_about_and_asking_again_answers_nothing(worked, how):
    from pyglet.window import key

    for again in ("key", "menu", "close", how):
        quit_by(worked, again)
        frames(worked)
        assert worked.questions.leaving.about == "work" and not worked.window.has_exit
    press(worked, key.ESCAPE)
    assert worked.questions.leaving is None and not worked.window.has_exit
    assert worked.scene.on_ground and worked.autosave.path.exists()
    assert not worked.gui._failed


def test_enter_saves_and_ends(worked, ball, tmp_path):
    from pyglet.window import key

    quit_by(worked, "key")
    frames(worked)
    kept = worked.autosave.path
    send(worked, "on_key_press", key.RETURN, 0)
    worked.run()
    worked.end()
    (path,) = (tmp_path / "here").glob("*.deformrf")
    assert "set_ground" in [event.name for event in load_project(path).session.events]
    assert not kept.exists() and left_behind(autosave_folder(), ball.mesh) is None


@pytest.mark.parametrize("label", ["Quit without saving", "Cancel"])
def test_only_discard_removes_what_is_kept(worked, places, label, tmp_path):
    kept = worked.autosave.path
    quit_by(worked, "close")
    frames(worked)
    click(worked, places[label])
    assert worked.window.has_exit == (label == "Quit without saving")
    worked.end()
    assert kept.exists() == (label == "Cancel") and not list((tmp_path / "here").glob("*.deformrf"))


def test_work_that_cant_be_saved_keeps_the_window_open_and_says_why(
    worked, monkeypatch, tmp_path, capfd
):
    from pyglet.window import key

    (tmp_path / "here").rmdir()
    monkeypatch.setenv("HOME", str(tmp_path / "absent"))  # where files go instead
    quit_by(worked, "key")
    frames(worked)
    press(worked, key.RETURN)
    assert not worked.window.has_exit and "No such file" in worked.questions.leaving.problem
    assert str(tmp_path / "absent") in worked.questions.leaving.problem
    assert worked.autosave.path.exists() and not worked.gui._failed
    monkeypatch.setenv("HOME", str(tmp_path))
    send(worked, "on_key_press", key.RETURN, 0)
    worked.run()
    assert len(list(tmp_path.glob("ball.deformrf"))) == 1


def test_save_writes_into_the_project_that_is_open(worked, tmp_path):
    from pyglet.window import key

    worked.save_project(tmp_path / "work.deformrf")
    worked.scene.set_gravity(3.0)
    worked.questions.leave()
    frames(worked)
    press(worked, key.RETURN)
    assert worked.window.has_exit and not list(tmp_path.rglob("session-*.jsonl"))
    events = load_project(tmp_path / "work.deformrf").session.events
    assert "set_gravity" in [event.name for event in events]


def test_what_is_saved_is_not_asked_about_until_more_is_done(worked):
    scene = worked.scene
    scene.body.set_material(damping=4.0)
    worked.save_session()
    assert not scene.journal.unsaved and not worked.autosave.path.exists()
    scene.body.set_material(damping=5.0)  # soon after: it would be the same step
    assert scene.journal.unsaved
    scene.undo()
    assert not scene.journal.unsaved
    scene.undo()
    assert scene.journal.unsaved
    scene.redo()
    assert not scene.journal.unsaved
    scene.undo()
    scene.set_ground(False)
    scene.undo()
    assert scene.journal.unsaved  # what was saved can't be reached any more


def test_a_drag_that_is_saved_in_its_middle_is_not_saved(app):
    scene, vertex = app.scene, int(app.scene.handles.control_ids[0])
    app.controls.press_at = app.controls.pointer = np.zeros(2)
    app.controls.grab(vertex)
    app.save_session()
    assert scene.journal.unsaved
    app.controls.cancel()
    assert not scene.journal.unsaved  # it came to nothing


def test_steps_that_are_forgotten_are_unsaved(app, monkeypatch):
    from deformrf.viewer.document.history import journal

    monkeypatch.setattr(journal, "FEWEST_STEPS", 2)
    monkeypatch.setattr(journal, "MOST_BYTES", 0)
    for on in (True, False, True, False):
        app.scene.set_ground(on)
    while app.scene.undo():
        pass
    assert app.scene.journal.unsaved


def test_a_session_that_is_opened_is_saved_and_one_that_was_left_behind_is_not(
    worked, ball, tmp_path
):
    path = save_session(worked.scene, worked.session_start, tmp_path / "s.jsonl")
    worked.opening.asked = path
    frames(worked)
    assert worked.scene.on_ground and not worked.scene.journal.unsaved
    worked.questions.left_behind = save_session(
        worked.scene, worked.session_start, autosave_folder() / "ball-999999999-1.jsonl"
    )
    worked.playing.recover()
    assert worked.scene.on_ground and worked.scene.journal.unsaved
    quit_by(worked, "key")
    assert worked.questions.leaving.about == "work"


def test_the_end_of_a_loop_that_asked_nobody_keeps_work(worked, ball):
    """As with --frames."""
    worked.end()
    assert left_behind(autosave_folder(), ball.mesh) == worked.autosave.path


def test_training_that_would_stop_is_asked_about(app, places):
    running = {"stays": False, "progress": None, "line": "", "paused": False, "trained": False}
    running |= {"ended": False, "stopping": False, "output": Path("model.npz"), "began": 0.0}
    app.train_job = SimpleNamespace(close=lambda: None, **running)
    quit_by(app, "key")
    frames(app)
    assert app.questions.leaving.about == "training" and not app.window.has_exit
    click(app, places["Stop it and quit"])
    assert app.window.has_exit


# -- a film ------------------------------------------------------------------------------------


@pytest.fixture
def filming(app):
    """The App while a process renders a film of it."""
    app.scene.clock.advance(0.2)
    app.takes.ask()
    app.takes.choices = FilmChoices("film", "as the window", 15, 1, handles=False)
    app.takes.start_film()
    frames(app)
    assert app.takes.job is not None
    return app


def test_a_film_is_waited_for(filming, tmp_path):
    from pyglet.window import key

    quit_by(filming, "key")
    frames(filming)
    assert filming.questions.leaving.about == "film"
    press(filming, key.ESCAPE)
    assert filming.questions.leaving is None and filming.takes.job is not None
    quit_by(filming, "close")
    frames(filming)
    press(filming, key.RETURN)
    assert filming.questions.leaving.waits and not filming.window.has_exit
    filming.run()
    assert (tmp_path / "here" / "film.mp4").exists()


def test_a_film_is_stopped(filming, places, tmp_path):
    quit_by(filming, "key")
    frames(filming)
    click(filming, places["Stop it and quit"])
    assert filming.window.has_exit and filming.takes.job is not None
    filming.takes.close()
    assert not (tmp_path / "here" / "film.mp4").exists()


def test_a_film_that_fails_while_it_is_waited_for_keeps_the_window(app, monkeypatch):
    from pyglet.window import key

    monkeypatch.setattr(FilmChoices, "arguments", lambda *_: ["--size", "9x9", "-o", "film.mp4"])
    app.takes.ask()
    app.takes.start_film()
    quit_by(app, "key")
    frames(app)
    press(app, key.RETURN)
    deadline = time.monotonic() + 60
    while app.takes.job is not None and time.monotonic() < deadline:
        frames(app)
    frames(app)
    assert app.questions.leaving is None and not app.window.has_exit
    assert "--size is 9x9" in app.recorder.message
