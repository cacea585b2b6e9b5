"""A run in a thread: its snapshots, its pauses, how it stops; without a window."""

import threading
import time
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from deformrf.core.training import load_checkpoint, preset, trainer
from deformrf.core.training.run import optimization
from deformrf.viewer.panels import training as panel
from deformrf.viewer.training import LiveRun
from deformrf.viewer.training import live as lives
from deformrf.viewer.training.live import Gate

FEW = preset(
    "tiny",
    spacing=0.15,
    coarse_steps=40,
    fine_steps=60,
    level_count=3,
    samples_per_step=2**12,
    march_step=0.06,
)


@pytest.fixture(scope="module", autouse=True)
def few_rays():
    """So that the first steps take no longer than the others."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(optimization, "RAYS_AT_START", optimization.FEWEST_RAYS)
        threads = torch.get_num_threads()
        torch.set_num_threads(1)  # on a busy machine, short steps of several wait for each other
        yield
        torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def trained(ball_data):
    return trainer.train(ball_data[0], FEW, "cpu", "ball")


@pytest.fixture
def often(monkeypatch):
    """Snapshots at every pause."""
    monkeypatch.setattr(lives, "SECONDS", 0.0)
    monkeypatch.setattr(lives, "AGE_SHARE", 0.0)
    monkeypatch.setattr(lives, "COST_SHARE", 1e9)


@pytest.fixture
def live():
    made = LiveRun("ball", "cpu")
    yield made
    made.paused = False
    made.stop()
    with suppress(BaseException):  # its test has seen it
        made.result()


def job(live, data, path=None, result=None):
    """The work of a run, as the command's; its Trained is added to `result`."""

    def work():
        found = trainer.train(data, FEW, "cpu", "ball", path, on_pause=live.on_pause)
        if result is not None:
            result.append(found)
        live.on_trained(found)
        return 7

    return work


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def taken(live):
    """All snapshots of a run, each taken as soon as it is there."""
    found = []
    wait_for(lambda: found.append(live.take()) or (live.ended and live.peek() is None))
    return [snapshot for snapshot in found if snapshot]


def parameters(field):
    layers = [a for pair in (*field.density_layers, *field.color_layers) for a in pair]
    return [field.table, *layers, field.occupancy]


def test_a_run_that_is_watched_ends_as_one_that_is_not(ball_data, trained, often, live):
    """To the last bit, though snapshots are made and bent at the same time."""
    result = []
    live.start(job(live, ball_data[0], result=result))
    stages, scene = [], None
    while not (live.ended and live.peek() is None):
        snapshot = live.take()
        if snapshot:
            stages.append(live.last.stage)
            scene = snapshot.scene or scene
            snapshot.renderer.set_vertices(scene.solver.vertices)
        if scene is not None:
            scene.handles.grab(int(scene.handles.control_ids[0]))
            scene.handles.drag_to(scene.positions.mean(axis=0) + np.array([0.3, 0.0, 0.0]))
            scene.advance(1.0 / 60.0)
            scene.handles.release()
        time.sleep(0.005)
    assert live.result() == 7
    assert set(stages) == {1, 2}
    for a, b in zip(parameters(trained.field), parameters(result[0].field), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_new_mesh_comes_with_a_scene_and_the_same_mesh_without(ball_data, often, live):
    live.start(job(live, ball_data[0]))
    snapshots = taken(live)
    assert len(snapshots) >= 4
    for before, now in zip([None, *snapshots], snapshots, strict=False):
        same = before is not None and now.field.mesh is before.field.mesh
        assert now.same_mesh == same
        assert now.scene is not None or same
    assert any(snapshot.scene is None for snapshot in snapshots)
    assert snapshots[-1].same_mesh and snapshots[-1].scene is not None  # the trained model's
    meshes = {id(snapshot.field.mesh) for snapshot in snapshots}
    assert len(meshes) == 2  # of the two stages


def test_a_scene_that_the_window_missed_comes_with_the_next_snapshot(field, often, live):
    pause = SimpleNamespace(stage=1, step=16, step_count=90, seconds=0.1, export=lambda: field)
    live.on_pause(pause)
    scene = live.peek().scene
    live.on_trained(SimpleNamespace(field=field))
    last = live.take()
    assert last.scene is not None and last.scene is not scene and not last.same_mesh
    assert live.peek() is None


def test_scenes_are_made_anew_while_the_object_becomes_clear(field, often, live):
    """At twice the steps of the last one, until the user has touched it."""

    def at(step):
        live.on_pause(
            SimpleNamespace(stage=1, step=step, step_count=900, seconds=0.1, export=lambda: field)
        )
        return live.take().scene is not None

    steps = range(16, 272, 16)
    assert [step for step in steps if at(step)] == [16, 32, 64, 128, 256]
    live.touched = True
    assert not at(512)


def test_snapshots_take_a_small_share_of_the_time(field, live, monkeypatch):
    """By a clock in which exporting takes 0.2 s and a pause comes every 0.1 s."""
    now = [0.0]
    live._clock = lambda: now[0]
    exports = []

    def export():
        now[0] += 0.2
        exports.append(now[0])
        return field

    while now[0] < 100.0:
        now[0] += 0.1
        live.on_pause(SimpleNamespace(stage=2, step=1, step_count=9, seconds=now[0], export=export))
        live.take()
    assert 0.7 * lives.COST_SHARE < 0.2 * len(exports) / now[0] < 1.5 * lives.COST_SHARE


def test_nobody_who_watches_costs_nothing(live):
    live.watched = False
    pause = SimpleNamespace(stage=1, step=16, step_count=90, seconds=0.1, export=None)
    live.on_pause(pause)
    live.on_trained(SimpleNamespace(field=None))
    assert live.peek() is None and live.last is pause


def test_a_field_that_cant_be_shown_leaves_the_run_alone(live, caplog):
    def export():
        raise MemoryError("too large")

    live.on_pause(SimpleNamespace(stage=1, step=16, step_count=90, seconds=0.1, export=export))
    assert not live.watched and "training goes on" in caplog.text


def test_a_run_waits_while_it_is_paused(ball_data, trained, live):
    result = []
    live.paused = True
    live.start(job(live, ball_data[0], result=result))
    wait_for(lambda: live.waiting)
    step = live.last.step
    time.sleep(0.3)
    assert (live.last.step, live.ended) == (step, False)
    live.paused = False
    wait_for(lambda: live.ended)
    assert result[0].report["seconds"] > 0.0
    for a, b in zip(parameters(trained.field), parameters(result[0].field), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("paused", [False, True])
def test_a_run_that_is_stopped_keeps_its_work(ball_data, live, tmp_path, paused):
    """As after Ctrl-C, even while it waits."""
    result, path = [], tmp_path / "ball.checkpoint"
    live.paused = paused
    live.start(job(live, ball_data[0], path, result))
    wait_for(lambda: live.peek())
    live.stop()
    assert live.result() == 7
    assert result[0].interrupted and result[0].resumable
    assert load_checkpoint(path).stage == live.last.stage


def test_an_error_of_the_run_reaches_who_waits_for_it(live):
    def fails():
        raise ValueError("no images")

    live.start(fails)
    with pytest.raises(ValueError, match="no images"):
        live.result()
    assert live.failed


def test_a_device_that_both_need_is_used_in_turns():
    """The run works between its pauses, the window within them, once each time."""
    gate, inside, running, overlaps = Gate(False), [], [True], []

    def window():
        while running[0]:
            with gate.entered(0.02) as entered:
                if entered:
                    inside.append(time.monotonic())
                    time.sleep(0.005)
                    inside.append(time.monotonic())

    thread = threading.Thread(target=window)
    thread.start()
    spans = []
    for _ in range(20):
        begin = time.monotonic()
        time.sleep(0.004)
        spans.append((begin, time.monotonic()))
        gate.pass_through()
    gate.pass_through(0.3)  # a run that waits lets it in again and again
    gate.open()
    running[0] = False
    thread.join()
    visits = list(zip(inside[::2], inside[1::2], strict=True))
    assert len(visits) >= 15
    for begin, end in spans:
        overlaps += [visit for visit in visits if visit[0] < end and visit[1] > begin]
    assert not overlaps


def row(stage, step, psnr):
    return {"stage": stage, "step": step, "psnr": psnr, "seconds": 1.0}


def test_the_curve_goes_on_from_stage_to_stage():
    steps, psnr = panel.curve([row(1, 16, 9.0), row(1, 40, 12.0), row(2, 16, 15.0)])
    assert steps.tolist() == [16.0, 40.0, 56.0] and psnr.tolist() == [9.0, 12.0, 15.0]
    steps, _ = panel.curve([row(2, 16, 15.0)])  # without a coarse stage
    assert steps.tolist() == [16.0]


def test_the_panel_says_how_far_the_run_is(live):
    live.last = SimpleNamespace(
        stage=2,
        step=100,
        step_count=600,
        seconds=187.0,
        samples_per_second=2.5e5,
        history=[row(2, 96, 21.456)],
    )
    live.steps_per_second = 5.0
    assert panel.training_lines(live) == [
        "stage 2 of 2, step 100 of 600",
        "21.46 dB on its training rays, 0.25 M samples/s",
        "3:07 so far, 1:40 left in this stage",
    ]
    live.waiting = True
    assert panel.training_lines(live)[0].endswith(", waiting")
    live.ended = True
    assert panel.training_lines(live)[0] == "the run is over after 3:07"


def test_a_second_stop_comes_at_once(live):
    """As a second Ctrl-C, while nothing pauses."""
    begun = threading.Event()

    def endless():
        begun.set()
        while True:
            time.sleep(0.01)

    live.start(endless)
    begun.wait()
    live.stop()
    time.sleep(0.1)
    assert not live.ended
    live.stop()
    with pytest.raises(KeyboardInterrupt):
        live.result()
