"""deformrf train --view: its window on a tiny run, and what it refuses."""

import json
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.commands import train as train_command
from deformrf.commands.running import INTERRUPTED
from deformrf.core import field as fields
from deformrf.core.field import modelfile
from deformrf.core.training import load_checkpoint
from deformrf.viewer.camera import picking
from deformrf.viewer.training import TrainJob, train_job, watching
from deformrf.viewer.window import WindowError

# Short first steps, snapshots at every pause; the fog of short runs stays in the mesh.
QUICK = """
import math
import torch
from deformrf.commands import train, training
from deformrf.core.training import preset, trained_tets
from deformrf.core.training.run import optimization
trained_tets.SPUR = 10**9
torch.set_num_threads(1)  # on a busy machine, short steps of several wait for each other
few = {"spacing": 0.15, "coarse_steps": 40, "fine_steps": 192, "level_count": 3}
training.train_options = lambda _: preset("tiny", samples_per_step=2**12, march_step=0.06, **few)
optimization.RAYS_AT_START = optimization.FEWEST_RAYS
train.TOLD_SECONDS, train.SECONDS, train.AGE_SHARE, train.COST_SHARE = 0.0, 0.0, 0.0, math.inf
sys.exit(train.main_of_job())
"""


@pytest.fixture
def quick(monkeypatch, window):
    """A run that shows all, in a window that never rests."""
    monkeypatch.setattr(train_job, "CODE", QUICK)
    monkeypatch.setattr(watching, "SHOW_SHARE", 1.0)
    monkeypatch.setattr(watching, "LONGEST_REST", 0.0)


@pytest.fixture
def arguments(ball_folder, tmp_path):
    return [str(ball_folder), "-o", str(tmp_path / "m.npz"), "--device", "cpu"]


@pytest.fixture
def job(quick, arguments, tmp_path):
    made = TrainJob(arguments, tmp_path / "m.npz", "cpu", stays=True)
    yield made
    made.close()


@pytest.fixture
def app(window, job):
    """The window of a run that has begun."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    app = App(*window, EventLog(False))
    app.watcher.begin(job)
    yield app
    app.train_job = None
    app.close()


def turn(app):
    if app.scene is None:
        app.show_alone(app.panels.training_window)
        app.watcher.follow()
    else:
        app.window.dispatch_events()
        app.frame(1.0 / 60.0)


def turns_until(app, condition):
    end = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < end and not (app.watcher.over and app.scene is None)
        turn(app)
        time.sleep(0.005)


@pytest.mark.gl
def test_the_object_is_dragged_while_it_is_trained(app, job):
    """Snapshots change the field alone: the drag, the pose and the camera stay."""
    from pyglet.window import mouse

    turns_until(app, lambda: app.scene is not None and job.progress["stage"] == 2)
    turns_until(app, lambda: app.watcher._field is not None and not job.snapshot)
    job.pause(True)
    turns_until(app, lambda: not job.snapshot and app.watcher._coming is None)
    scene = app.scene
    scene.settings.show_panel = False
    scene.orbit = replace(scene.orbit, yaw=1.0)
    count = app.frame_count
    turns_until(app, lambda: app.frame_count > count + 3)
    controls = app.controls
    ids = scene.handles.control_ids
    pixels, _ = picking.project(controls.camera, scene.handles.at(ids))
    places = [(round(x), round(app.window.height - 1 - y)) for x, y in pixels]
    x, y = next(
        place
        for place, pixel in zip(places, pixels, strict=True)
        if not app.gui.covers(*place) and controls.pick(pixel) is not None
    )
    app.window.dispatch_event("on_mouse_motion", x, y, 0, 0)
    app.window.dispatch_event("on_mouse_press", x, y, mouse.LEFT, 0)
    app.window.dispatch_event("on_mouse_drag", x + 25, y + 10, 25, 10, mouse.LEFT, 0)
    turn(app)
    assert controls.mode == "grab"
    rest = scene.field.mesh.rest_vertices
    turns_until(app, lambda: abs(scene.positions - rest).max() > 0.02 * scene.size)
    before, renders = scene.field, app.radiance.render_count
    job.pause(False)
    turns_until(app, lambda: scene.field is not before)
    turns_until(app, lambda: app.radiance.render_count > renders)
    assert app.scene is scene and scene.handles.grabbed is not None and scene.orbit.yaw == 1.0
    assert abs(scene.positions - rest).max() > 0.02 * scene.size
    assert not np.array_equal(before.table, scene.field.table)
    turns_until(app, lambda: app.watcher.over)
    assert app.scene is scene and scene.handles.grabbed is not None
    app.window.dispatch_event("on_mouse_release", x + 25, y + 10, mouse.LEFT, 0)


@pytest.mark.gl
def test_a_model_that_nobody_touched_gets_new_handles_at_the_end(app, job, tmp_path):
    turns_until(app, lambda: app.scene is not None)
    first = app.scene
    settings, home = first.settings, first.orbit
    assert not settings.accumulate
    turns_until(app, lambda: app.watcher.over)
    last = app.scene
    assert last is not first and last.settings is settings and last.orbit.distance < home.distance
    assert settings.accumulate and app.autosave is not None
    assert job.wait() == 0 and last.source == tmp_path / "m.npz"
    assert fields.same_values(last.field, fields.load(last.source))


def shown(arguments, window, output):
    return train_command.show(arguments, output, "cpu", *window)


@pytest.mark.gl
def test_training_goes_on_after_the_window_is_closed(
    window, quick, arguments, tmp_path, capsys, monkeypatch
):
    follow = watching.Watcher.follow

    def closing(self):
        follow(self)
        self.app.window.has_exit = self.job.progress is not None

    monkeypatch.setattr(watching.Watcher, "follow", closing)
    assert shown(arguments, window, tmp_path / "m.npz") == 0
    said = capsys.readouterr().out
    assert "training goes on" in said and "Wrote: " in said
    assert modelfile.load(tmp_path / "m.npz")


@pytest.mark.gl
@pytest.mark.parametrize("paused", [False, True])
def test_ctrl_c_keeps_the_work(window, quick, arguments, tmp_path, monkeypatch, capsys, paused):
    def interrupted(self):
        if self.job.progress is not None:
            if paused:
                self.job.pause(True)
                time.sleep(0.3)
            raise KeyboardInterrupt

    monkeypatch.setattr(watching.Watcher, "follow", interrupted)
    assert shown(arguments, window, tmp_path / "m.npz") == INTERRUPTED
    assert "Stopped early" in capsys.readouterr().out
    assert load_checkpoint(tmp_path / "m.checkpoint") and modelfile.load(tmp_path / "m.npz")


@pytest.mark.gl
def test_a_fault_of_the_view_leaves_the_run_alone(
    window, quick, arguments, tmp_path, caplog, monkeypatch
):
    def fails(self):
        raise RuntimeError("the driver is gone")

    monkeypatch.setattr(watching.Watcher, "follow", fails)
    assert shown(arguments, window, tmp_path / "m.npz") == 0
    assert "training goes on" in caplog.text


@pytest.mark.soak
@pytest.mark.gl
def test_a_snapshot_that_cant_be_shown_leaves_the_run_alone(app, job, monkeypatch, caplog):
    monkeypatch.setattr(fields, "load", lambda *_: 1 / 0)
    while not app.watcher.over:
        turn(app)
    assert app.scene is None and job.code == 0 and "training goes on" in caplog.text


@pytest.mark.gl
def test_the_whole_command_shows_and_writes(call, window, quick, arguments, tmp_path, monkeypatch):
    monkeypatch.setattr(train_command, "_open_window", lambda name: window)
    monkeypatch.setattr("deformrf.viewer.app.App.run", lambda self: self.frame(0.0))
    result = call(train_command.main, *arguments, "--view")
    assert result.code == 0 and str(tmp_path / "m.npz") in result.out
    assert modelfile.load(tmp_path / "m.npz")


@pytest.mark.gl
def test_a_run_that_is_watched_ends_as_one_that_is_not(app, job, arguments, tmp_path):
    """To the last bit, though its snapshots are bent, and it waited."""

    def bend():
        if app.scene is not None and job.progress["stage"] == 2:
            app.scene.handles.grab(int(app.scene.handles.control_ids[0]))
            app.scene.handles.drag_to(app.scene.positions.mean(axis=0) + np.array([0.3, 0.0, 0.0]))
            job.pause(not job.paused and not job.trained)
        return app.watcher.over

    turns_until(app, bend)
    watched = modelfile.load(tmp_path / "m.npz")
    job.close()
    alone = TrainJob([*arguments, "-o", str(tmp_path / "n.npz")], tmp_path / "n.npz", "cpu")
    assert alone.wait() == 0, alone.line
    bare = modelfile.load(tmp_path / "n.npz")
    assert fields.same_values(replace(watched, meta={}), replace(bare, meta={}))


def test_without_view_no_window_opens(call, data, tmp_path, trainer, monkeypatch):
    monkeypatch.setattr(train_command, "_open_window", lambda name: pytest.fail("a window opened"))
    result = call(train_command.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert result.code == 0 and len(trainer.calls) == 1
    assert "--view " in call(train_command.main, "--help").out


def test_view_without_a_display_is_refused_before_training(
    call, data, tmp_path, trainer, monkeypatch, refused
):
    def no_display(*_, **__):
        raise WindowError("there is no display to open a window on; with --headless it renders")

    monkeypatch.setattr("deformrf.viewer.window.open_window", no_display)
    arguments = ("-o", tmp_path / "m.npz", "--device", "cpu", "--preset", "tiny", "--view")
    message = refused(call(train_command.main, data, *arguments))
    assert "without --view the run needs none" in message and "headless" not in message
    assert not trainer.calls


@pytest.mark.parametrize("package", ["pyglet", "moderngl", "imgui_bundle"])
def test_view_without_its_packages_is_refused(
    call, data, tmp_path, trainer, monkeypatch, refused, package
):
    import importlib.util

    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == package else find_spec(name)
    )
    arguments = ("-o", tmp_path / "m.npz", "--device", "cpu", "--preset", "tiny", "--view")
    assert package in refused(call(train_command.main, data, *arguments))
    assert not trainer.calls


def test_several_processes_show_no_view(call, data, tmp_path, trainer, monkeypatch, refused):
    monkeypatch.setenv("WORLD_SIZE", "2")
    arguments = ("-o", tmp_path / "m.npz", "--device", "cpu", "--preset", "tiny", "--view")
    assert "one process" in refused(call(train_command.main, data, *arguments))
    assert not trainer.calls


@pytest.mark.gl
def test_the_window_can_be_quit_before_its_first_picture(app):
    from pyglet.window import key

    assert app.scene is None
    app.window.dispatch_event("on_key_press", key.Q, key.MOD_CTRL)
    app.window.dispatch_events()
    assert app.window.has_exit


@pytest.mark.gl
def test_a_trained_model_is_as_one_that_was_opened(app, job, ball, monkeypatch, tmp_path):
    """What is done to it is kept, and the run is forgotten with it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    turns_until(app, lambda: app.watcher.over)
    app.scene.set_ground(True)
    app.autosave._next = 0.0
    app.frame(0.0)
    assert app.autosave.path.exists() and app.train_job is job
    app.load(ball, "ball", "cpu")
    assert app.train_job is None


# -- what a run tells --------------------------------------------------------------------------


def pause_at(step, export, seconds=0.1, stage=1):
    return SimpleNamespace(
        stage=stage,
        step=step,
        step_count=90,
        seconds=seconds,
        samples_per_second=2.0,
        history=[],
        export=export,
    )


def events(capsys):
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_a_run_tells_of_its_steps_now_and_then(tmp_path, capsys):
    now = [0.0]
    told = train_command.Telling(tmp_path / "s.npz", lambda: now[0])
    told._due = 9.0
    for step in range(3):
        told.on_pause(pause_at(16 * step, None))
        now[0] += 0.4
    assert [event["step"] for event in events(capsys)] == [0, 32]


def test_a_snapshot_is_written_when_the_last_one_was_read(field, tmp_path, capsys):
    now, path = [0.0], tmp_path / "s.npz"
    told = train_command.Telling(path, lambda: now[0])
    for step in (16, 32, 48):
        told.on_pause(pause_at(step, lambda: field))
        now[0] += 20.0
        if step == 32:
            assert np.array_equal(modelfile.load(path).mesh.tets, field.mesh.tets)
            path.unlink()
    written = [event["step"] for event in events(capsys) if event["event"] == "snapshot"]
    assert written == [16, 48]


def test_snapshots_take_a_small_share_of_the_time(field, tmp_path):
    """By a clock in which exporting takes 0.2 s and a pause comes every 0.1 s."""
    now, exports = [0.0], []
    told = train_command.Telling(tmp_path / "s.npz", lambda: now[0])

    def export():
        now[0] += 0.2
        exports.append(now[0])
        return field

    while now[0] < 100.0:
        now[0] += 0.1
        told.on_pause(pause_at(1, export, now[0], 2))
        told.snapshot.unlink(missing_ok=True)
    share = 0.2 * len(exports) / now[0]
    assert 0.7 * train_command.COST_SHARE < share < 1.5 * train_command.COST_SHARE


def test_a_field_that_cant_be_written_leaves_the_run_alone(tmp_path, caplog):
    def export():
        raise MemoryError("too large")

    told = train_command.Telling(tmp_path / "s.npz")
    for _ in range(2):
        told.on_pause(pause_at(16, export))
    assert caplog.text.count("training goes on") == 1
