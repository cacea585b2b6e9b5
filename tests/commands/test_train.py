"""deformrf train --view: its window on a tiny run, and what it refuses."""

import time
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
import torch

from deformrf.commands import train as train_command
from deformrf.commands.running import INTERRUPTED
from deformrf.core.field import modelfile
from deformrf.core.training import preset, trained_tets, trainer
from deformrf.core.training.run import optimization
from deformrf.viewer.camera import picking
from deformrf.viewer.training import LiveRun
from deformrf.viewer.training import live as lives
from deformrf.viewer.training.live import Gate
from deformrf.viewer.window import WindowError

FEW = preset(
    "tiny",
    spacing=0.15,
    coarse_steps=40,
    fine_steps=64,
    level_count=3,
    samples_per_step=2**12,
    march_step=0.06,
)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Short first steps, snapshots at every pause; the fog of short runs stays in the mesh."""
    monkeypatch.setattr(trained_tets, "SPUR", 10**9)
    monkeypatch.setattr(optimization, "RAYS_AT_START", optimization.FEWEST_RAYS)
    monkeypatch.setattr(lives, "SECONDS", 0.0)
    monkeypatch.setattr(lives, "AGE_SHARE", 0.0)
    monkeypatch.setattr(lives, "COST_SHARE", 1e9)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # on a busy machine, short steps of several wait for each other
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def live_window(window, monkeypatch):
    """The module, which can be imported now; without rests between frames."""
    from deformrf.viewer.training import live_window

    monkeypatch.setattr(live_window, "SHOW_SHARE", 1.0)
    return live_window


@pytest.fixture
def live():
    made = LiveRun("ball", "cpu")
    yield made
    made.paused = False
    made.stop()
    with suppress(KeyboardInterrupt):
        made.result()


@pytest.fixture
def job(ball_data, live):
    def work():
        live.on_trained(trainer.train(ball_data[0], FEW, "cpu", "ball", on_pause=live.on_pause))
        return 7

    return work


@pytest.fixture
def shown(window, live_window, live, job):
    """The window of a run that has begun."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    app = App(*window, EventLog(False))
    made = live_window.LiveWindow(app, live)
    live.start(job)
    yield made
    live.watched = False
    app.close()


def turns_until(shown, condition):
    end = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < end
        shown.turn()
        time.sleep(0.005)


@pytest.mark.gl
def test_the_object_is_dragged_while_it_is_trained(shown, live):
    """Snapshots change the field alone: the drag, the pose and the camera stay."""
    from pyglet.window import mouse

    app = shown.app
    turns_until(shown, lambda: app.scene is not None and live.last.stage == 2)
    live.paused = True
    turns_until(shown, lambda: live.waiting and live.peek() is None)
    scene = app.scene
    scene.settings.show_panel = False
    scene.orbit = replace(scene.orbit, yaw=1.0)
    count = app.frame_count
    turns_until(shown, lambda: app.frame_count > count + 3)
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
    shown.turn()
    assert controls.mode == "grab"
    rest = scene.field.mesh.rest_vertices
    turns_until(shown, lambda: abs(scene.positions - rest).max() > 0.02 * scene.size)
    before, renders = scene.field, app.radiance.render_count
    live.paused = False
    turns_until(shown, lambda: scene.field is not before)
    turns_until(shown, lambda: app.radiance.render_count > renders)
    assert app.scene is scene and scene.handles.grabbed is not None and scene.orbit.yaw == 1.0
    assert abs(scene.positions - rest).max() > 0.02 * scene.size
    assert not np.array_equal(before.table, scene.field.table)
    turns_until(shown, lambda: live.ended and live.peek() is None)
    assert app.scene is scene and scene.handles.grabbed is not None
    app.window.dispatch_event("on_mouse_release", x + 25, y + 10, mouse.LEFT, 0)


@pytest.mark.gl
def test_a_model_that_nobody_touched_gets_new_handles_at_the_end(shown, live):
    turns_until(shown, lambda: shown.app.scene is not None)
    first = shown.app.scene
    settings, home = first.settings, first.orbit
    turns_until(shown, lambda: live.ended and live.peek() is None)
    last = shown.app.scene
    assert last is not first and last.settings is settings and last.orbit.distance < home.distance
    assert live.result() == 7


@pytest.mark.gl
def test_training_goes_on_after_the_window_is_closed(
    window, live_window, live, job, capsys, monkeypatch
):
    turn = live_window.LiveWindow.turn

    def closing(self):
        drawn = turn(self)
        self.app.window.has_exit = live.last is not None
        return drawn

    monkeypatch.setattr(live_window.LiveWindow, "turn", closing)
    assert train_command.show(live, job, *window) == 7
    assert live.trained and not live.stopping
    assert "training goes on" in capsys.readouterr().out


@pytest.mark.gl
def test_ctrl_c_keeps_the_work(window, live_window, live, ball_data, monkeypatch):
    result = []

    def work():
        result.append(trainer.train(ball_data[0], FEW, "cpu", "ball", on_pause=live.on_pause))
        return INTERRUPTED

    def interrupted(self):
        if live.last is not None:
            raise KeyboardInterrupt
        return False

    monkeypatch.setattr(live_window.LiveWindow, "turn", interrupted)
    assert train_command.show(live, work, *window) == INTERRUPTED
    assert result[0].interrupted


@pytest.mark.gl
def test_a_fault_of_the_view_leaves_the_run_alone(
    window, live_window, live, job, caplog, monkeypatch
):
    def fails(self):
        raise RuntimeError("the driver is gone")

    monkeypatch.setattr(live_window.LiveWindow, "turn", fails)
    assert train_command.show(live, job, *window) == 7
    assert live.trained and "training goes on" in caplog.text


@pytest.mark.gl
def test_the_whole_command_shows_and_writes(call, data, window, tmp_path, trainer, monkeypatch):
    """With a trainer that stands in: it pauses once."""
    output, pauses = tmp_path / "m.npz", []

    def train_once(*arguments, workers, on_pause):
        pauses.append(on_pause)
        return trainer.trained

    trainer.train = train_once
    monkeypatch.setattr(train_command, "_open_window", lambda name: window)
    monkeypatch.setattr("deformrf.viewer.app.App.run", lambda self: self.frame(0.0))
    arguments = ("-o", output, "--device", "cpu", "--preset", "tiny", "--view")
    result = call(train_command.main, data, *arguments)
    assert result.code == 0 and str(output) in result.out
    assert len(pauses) == 1 and modelfile.load(output)


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
def test_the_window_is_closed_while_the_run_pauses(window, live_window, live, monkeypatch):
    """What CUDA frees would get into a graph that the run records."""
    from deformrf.viewer.app import App

    live.gate = Gate(False)
    busy, seen = [True], []

    def work():
        end = time.monotonic() + 30.0
        while not seen and time.monotonic() < end:
            busy.append(True)
            time.sleep(0.02)
            busy.clear()
            live.gate.pass_through()
        return 7

    close = App.close
    monkeypatch.setattr(App, "close", lambda app: (seen.append(bool(busy)), close(app)))
    window[0].has_exit = True
    assert train_command.show(live, work, *window) == 7
    assert seen == [False]


@pytest.mark.gl
def test_the_window_can_be_quit_before_its_first_picture(shown):
    from pyglet.window import key

    assert shown.app.scene is None
    shown.app.window.dispatch_event("on_key_press", key.Q, key.MOD_CTRL)
    shown.app.window.dispatch_events()
    assert shown.app.window.has_exit


@pytest.mark.gl
def test_a_trained_model_is_as_one_that_was_opened(shown, live, ball, monkeypatch, tmp_path):
    """What is done to it is kept, and the run is forgotten with it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    turns_until(shown, lambda: live.ended and live.peek() is None)
    monkeypatch.setattr(shown.app, "run", lambda: shown.app.scene.set_ground(True))
    shown.run()
    shown.app.autosave._next = 0.0
    shown.app.frame(0.0)
    assert shown.app.autosave.path.exists() and shown.app.live is live
    shown.app.load(ball, "ball", "cpu")
    assert shown.app.live is None
