"""What is kept of a viewer that did not end in order."""

import os
import signal
import subprocess
import sys
from dataclasses import asdict
from threading import Thread

import numpy as np
import pytest

from deformrf.viewer.document import Scene, SessionError, load_session, save_session, start_of
from deformrf.viewer.document.sessions import autosave as a


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


@pytest.fixture
def saved(scene, tmp_path):
    """An Autosave, and its clock."""
    clock = Clock()
    return a.Autosave(scene, start_of(scene), tmp_path / "kept", clock), clock


def pass_time(saved, seconds):
    saved[1].now += seconds
    saved[0].update()


def test_edits_are_kept_after_some_seconds_and_views_alone_are_not(saved, scene, ball):
    scene.note_view()
    pass_time(saved, 2 * a.SECONDS)
    assert not saved[0].path.exists()
    scene.set_ground(True)
    pass_time(saved, 0.1)
    assert not saved[0].path.exists()
    pass_time(saved, a.SECONDS)
    assert [e.name for e in load_session(saved[0].path, ball).events] == ["view", "set_ground"]
    scene.set_ground(False)
    pass_time(saved, 100.0)
    assert len(load_session(saved[0].path, ball).events) == 3


def test_the_file_grows_by_what_is_new_and_a_line_that_was_cut_off_is_left_out(
    saved, scene, ball, tmp_path
):
    """It reads as a file that was written at once; a stop while it is written loses one line."""
    kept = saved[0]
    scene.body.set_material(damping=4.0)
    pass_time(saved, 6)
    begun = kept.path.read_bytes()
    scene.set_gravity(9.81)
    scene.clock.advance(0.1)
    scene.hold(False)
    pass_time(saved, 3600)
    grown = kept.path.read_bytes()
    assert grown.startswith(begun) and len(grown) > len(begun)
    at_once = save_session(scene, kept._start, tmp_path / "whole.jsonl")
    expected = load_session(at_once, ball).events
    assert load_session(kept.path, ball).events == expected
    kept.path.write_bytes(grown[:-9])
    with pytest.raises(SessionError):
        load_session(kept.path, ball)
    assert load_session(kept.path, ball, whole=False).events == expected[:-1]


def test_a_viewer_that_ends_in_order_leaves_nothing(saved, scene):
    scene.set_ground(True)
    pass_time(saved, a.SECONDS)
    assert saved[0].path.exists()
    saved[0].end()
    assert not saved[0].path.exists()


def test_a_folder_that_cant_be_written_stops_nothing(scene, tmp_path):
    (tmp_path / "file").touch()
    clock = Clock()
    made = a.Autosave(scene, start_of(scene), tmp_path / "file" / "in it", clock)
    scene.set_ground(True)
    clock.now = 100.0
    for _ in range(2):
        assert "can't be kept" in made.update() and made.failed
        assert not made.update()  # in this minute
        clock.now += a.RETRY
    made.end()


def test_after_a_failure_the_whole_file_is_written_a_minute_later(
    saved, scene, ball, tmp_path, monkeypatch
):
    """A disk that was full may have half of a line."""
    scene.set_ground(True)
    pass_time(saved, a.SECONDS)

    def fail(scene, path, written, tell):
        with open(path, "a") as file:
            file.write('[3, "set_gr')
        raise OSError(28, "No space left on device")

    scene.set_ground(False)
    with monkeypatch.context() as full:
        full.setattr(a, "append_events", fail)
        pass_time(saved, 3600)
    assert saved[0].failed
    with pytest.raises(SessionError):
        load_session(saved[0].path, ball)
    scene.set_ground(True)
    pass_time(saved, a.RETRY)
    assert not saved[0].failed and len(load_session(saved[0].path, ball).events) == 3


def test_an_interrupt_while_the_file_grows_doubles_nothing(saved, scene, ball, monkeypatch):
    """SIGTERM comes when it comes: what is kept then has each edit once."""
    scene.set_ground(True)
    pass_time(saved, a.SECONDS)
    append = a.append_events

    def interrupted(*arguments):
        append(*arguments)
        raise KeyboardInterrupt

    scene.set_ground(False)
    with monkeypatch.context() as signal, pytest.raises(KeyboardInterrupt):
        signal.setattr(a, "append_events", interrupted)
        pass_time(saved, 3600)
    (sentence,) = saved[0].keep()
    assert "is kept" in sentence
    assert [e.name for e in load_session(saved[0].path, ball).events] == 2 * ["set_ground"]


def test_what_another_run_left_is_found_and_what_runs_is_not(saved, scene, ball, tmp_path):
    kept = tmp_path / "kept"
    assert a.left_behind(kept, ball.mesh) is None
    scene.set_ground(True)
    pass_time(saved, a.SECONDS)
    alive = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    running = kept / f"ball-{alive.pid}-1.jsonl"
    saved[0].path.rename(running)
    assert a.left_behind(kept, ball.mesh) is None  # a viewer is writing it
    os.utime(running, (0, 0))
    assert a.left_behind(kept, ball.mesh) == running  # no, another program has the number
    alive.communicate()
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    dead = kept / f"ball-{gone.pid}-1.jsonl"
    running.rename(dead)
    os.utime(dead)
    assert a.left_behind(kept, ball.mesh) == dead
    other = kept / f"other-{gone.pid}-2.jsonl"
    other.write_text(dead.read_text().replace('"rest": "', '"rest": "0'))
    assert a.left_behind(kept, ball.mesh) == dead  # another mesh's is not offered


@pytest.mark.parametrize("content", [b"", b"\xff", b"[]", b"[" * 10**6])
def test_other_files_in_the_folder_stop_nothing(ball, tmp_path, content):
    (tmp_path / "x.jsonl").write_bytes(content)
    assert a.left_behind(tmp_path, ball.mesh) is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes in folders")
def test_a_pipe_in_the_folder_is_not_waited_for(ball, tmp_path):
    os.mkfifo(tmp_path / "x.jsonl")
    looks = Thread(target=a.left_behind, args=(tmp_path, ball.mesh), daemon=True)
    looks.start()
    looks.join(10.0)
    assert not looks.is_alive()


def test_the_folder_is_the_users(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    if os.name == "posix":
        assert tmp_path in a.autosave_folder().parents


# -- in the viewer -----------------------------------------------------------------------------


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    """An App with panels in a window without a display."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    made = App(*window, EventLog(False))
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.25
    frames(made, 2)
    yield made
    made.close()


def frames(app, count):
    app.run(app.frame_count + count)


@pytest.mark.gl
def test_a_session_that_was_left_behind_is_offered_and_goes_on(app, ball, tmp_path):
    scene = app.scene
    vertex = int(scene.handles.control_ids[0])
    scene.handles.grab(vertex)
    scene.handles.drag_to(scene.handles.grabbed.target.place + np.array([0.1, 0.0, 0.0]))
    frames(app, 3)
    scene.handles.release()
    scene.set_ground(True)
    a.autosave_folder().mkdir(parents=True, exist_ok=True)
    path = save_session(scene, app.session_start, a.autosave_folder() / "ball-999999999-1.jsonl")
    bent = scene.solver.vertices.numpy().copy()
    labels = [step.label for step in scene.journal.steps]
    app.questions.left_behind = a.left_behind(a.autosave_folder(), ball.mesh)
    assert app.questions.left_behind == path
    scene.body.set_material(young_modulus=2e6)  # is forgotten
    app.playing.recover()
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), bent)
    assert [step.label for step in scene.journal.steps] == labels and scene.on_ground
    assert scene.body.material.young_modulus == 1e6
    assert not path.exists() and app.questions.left_behind is None
    frames(app, 2)
    assert scene.undo() and scene.undo() and not scene.undo()


@pytest.mark.gl
def test_a_session_that_ended_at_a_pose_of_the_timeline_shows_it(app, ball):
    scene = app.scene
    vertex = int(scene.handles.control_ids[0])
    scene.handles.grab(vertex)
    scene.handles.drag_to(scene.handles.grabbed.target.place + np.array([0.1, 0.0, 0.0]))
    frames(app, 3)
    scene.timeline.save_pose("bent")
    scene.handles.release()
    scene.timeline.blend_pose("bent", 0.5)
    bent = scene.solver.vertices.numpy().copy()
    a.autosave_folder().mkdir(parents=True, exist_ok=True)
    app.questions.left_behind = save_session(
        scene, app.session_start, a.autosave_folder() / "ball-999999999-1.jsonl"
    )
    app.playing.recover()
    scene.clock.advance(0.1)
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), bent)
    assert scene.clock.paused and scene.timeline.stands
    while scene.undo():
        pass
    assert not scene.clock.paused


@pytest.mark.gl
def test_a_damaged_session_that_was_left_behind_is_told_of(app, tmp_path):
    app.questions.left_behind = tmp_path / "damaged.jsonl"
    app.questions.left_behind.write_text("{}")
    frames(app, 2)  # the question is drawn
    app.playing.recover()
    assert "not a session" in app.recorder.message and (tmp_path / "damaged.jsonl").exists()


@pytest.mark.gl
def test_what_is_done_is_kept_while_the_viewer_runs(app):
    app.scene.set_ground(True)
    app.autosave._next = 0.0
    frames(app, 1)
    path = app.autosave.path
    assert path.exists()
    app.autosave.end()
    assert not path.exists()


@pytest.mark.gl
def test_the_window_shows_how_far_a_long_session_has_been_played(app, ball, monkeypatch):
    """The button is in a panel: nothing is played before that panel's frame has ended."""
    from imgui_bundle import imgui

    from deformrf.viewer import playing
    from deformrf.viewer.document.sessions import player

    app.scene.set_ground(True)
    app.scene.timeline.turntable(40, asdict(app.scene.orbit))
    app.scene.journal.tick = 100
    a.autosave_folder().mkdir(parents=True, exist_ok=True)
    path = save_session(
        app.scene, app.session_start, a.autosave_folder() / "ball-999999999-1.jsonl"
    )
    app.scene.set_ground(False)
    shown, draw = [], app.panels.playing_window
    monkeypatch.setattr(playing, "SILENT_SECONDS", 0.0)
    monkeypatch.setattr(player, "BATCH_SECONDS", 0.0)
    monkeypatch.setattr(app.panels, "playing_window", lambda *at: (shown.append(at), draw(*at)))
    app.questions.left_behind = path
    with monkeypatch.context() as clicked:
        button = imgui.button
        answer = "Go on with it"
        clicked.setattr(
            imgui, "button", lambda label, *size: button(label, *size) or label == answer
        )
        frames(app, 1)
    assert shown == [] and not app.scene.on_ground
    frames(app, 2)
    assert 90 < shown[-1][0] <= 100 and shown[-1][1].total == 100
    assert app.scene.on_ground and app.questions.left_behind is None
    assert not app.gui._failed  # panels


@pytest.mark.gl
def test_an_interrupt_keeps_what_was_done_since_the_last_writing(app, ball, monkeypatch):
    """SIGTERM, or SIGHUP when the terminal is closed, which `commands.run` makes a Ctrl-C."""
    from deformrf.commands import view as command

    app.begin_autosave()
    app.scene.set_ground(True)
    path = app.autosave.path
    assert not path.exists()

    def interrupted(frames):
        raise KeyboardInterrupt

    write = app.autosave.save

    def save():  # the second signal of an impatient user
        signal.raise_signal(signal.SIGINT)  # this thread has it before the next line
        write()

    app.autosave.save = save
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(app, "run", interrupted)
        patched.setattr(app, "close", lambda: None)  # the fixture does it
        command._show(app, command.ViewArguments(), None)
    assert "set_ground" in [e.name for e in load_session(path, ball).events]
    path.unlink()
