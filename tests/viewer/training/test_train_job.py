"""Photographs that are opened: the viewer asks, trains in another process, and shows the model."""

import time
from pathlib import Path

import pytest
from PIL import Image

from deformrf.commands import view as command
from deformrf.viewer.training import TrainJob, TrainOffer, offer_of, train_job

WORKS = """
import json, sys, time
step = {"event": "step", "stage": 2, "step": 30, "steps": 60, "seconds": 9.0, "rate": 1e5}
print(json.dumps(step | {"history": []}), flush=True)
model = open(MODEL, "rb").read()
open(sys.argv[1], "wb").write(model)
print(json.dumps({"event": "snapshot", "path": sys.argv[1], "step": 30}), flush=True)
print("words for people", flush=True)
while WAITS and sys.stdin.readline().strip() != "go on":
    pass
open(sys.argv[4], "wb").write(model)
"""
FAILS = "import sys; print('deformrf train: too few photographs'); sys.exit(2)"
WAITS = """
import sys
print("ready", flush=True)
if sys.stdin.readline().strip() == "stop":
    print("kept the work", flush=True)
    sys.exit(130)
"""


@pytest.fixture
def photos(tmp_path):
    folder = tmp_path / "my toy"
    folder.mkdir()
    for number in range(5):
        Image.new("RGB", (32, 24), (40 * number, 90, 60)).save(folder / f"{number}.jpg")
    return folder


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def works(ball_file, waits=False):
    """The code of a run that shows a snapshot, and may wait until it is told to go on."""
    return WORKS.replace("MODEL", repr(str(ball_file))).replace("WAITS", repr(waits))


def begun(photos):
    offer = offer_of(photos, "cpu")
    return TrainJob(offer.arguments, offer.output, "cpu")


def ended(job, seconds=30):
    end = time.monotonic() + seconds
    while not job.ended:
        assert time.monotonic() < end
        time.sleep(0.02)
    return job


def test_an_offer_says_what_would_happen(photos, tmp_path):
    offer = offer_of(photos, "cpu")
    assert (offer.count, offer.output) == (5, tmp_path / "my toy.npz")
    text = " ".join(offer.lines())
    assert "5 photographs" in text and f"{offer.minutes} minutes on this CPU" in text
    assert f"deformrf train '{photos}' -o" in offer.command and "--preset tiny" in offer.command
    on_gpu = offer_of(photos, "cuda:0")
    assert "a GPU" in " ".join(on_gpu.lines()) and "tiny" not in on_gpu.command
    assert on_gpu.minutes < offer.minutes
    offer.output.write_bytes(b"")  # a model that is there is never replaced
    assert offer_of(photos, "cpu").output.name == "my toy-2.npz"


def test_an_offer_names_raw_files_that_are_left_out(photos):
    (photos / "later.dng").touch()
    assert any(
        "1 raw file" in line and "later.dng" in line for line in offer_of(photos, "cpu").lines()
    )


def test_the_command_that_is_offered_is_one(photos):
    from deformrf.commands.options import parsed
    from deformrf.commands.training import TrainArguments

    offer = offer_of(photos, "cpu")
    chosen = parsed("deformrf train", TrainArguments, offer.arguments)
    assert (chosen.data, chosen.output, chosen.preset) == (photos, offer.output, "tiny")


def test_a_job_tells_how_far_it_is_and_its_last_words(photos, monkeypatch, ball_file):
    monkeypatch.setattr(train_job, "CODE", works(ball_file))
    job = ended(begun(photos))
    assert (job.code, job.line, job.progress["step"]) == (0, "words for people", 30)
    monkeypatch.setattr(train_job, "CODE", FAILS)
    job = ended(begun(photos))
    assert job.code == 2 and "too few photographs" in job.line


def test_a_job_that_is_stopped_keeps_its_work(photos, monkeypatch, capsys):
    monkeypatch.setattr(train_job, "CODE", WAITS)
    job = begun(photos)
    while job.line != "ready":
        assert not job.ended
        time.sleep(0.02)
    job.close()
    assert job.ended and job.code == 130 and job.line == "kept the work"
    assert "Training stops" in capsys.readouterr().err


def test_the_process_is_deformrf_train(photos):
    """Five photographs of nothing are refused by it, in a sentence."""
    job = ended(begun(photos), 120)
    assert (job.code, job.line.partition(":")[0]) == (2, "deformrf train"), job.line
    assert "5 photographs" in job.line


def test_without_a_window_a_sentence_has_the_command(photos, capsys):
    arguments = [str(photos), "--headless", "--screenshot", "x.png"]
    assert command.main(arguments) == 2
    said = capsys.readouterr().err
    assert f"deformrf train '{photos}' -o model.npz" in said


# -- in the viewer -----------------------------------------------------------------------------


@pytest.fixture
def app(give_up_window, ball):
    """An App in a window without a display, large enough for a dialog."""
    from deformrf.viewer.window import WindowError, open_window

    try:
        window = open_window((700, 500), headless=True)
    except WindowError as error:
        give_up_window(str(error))
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    app = App(*window, EventLog(False))
    app.load(ball, "ball", "cpu")
    app.questions.left_behind = None
    yield app
    app.end()
    app.close()


def drop(app, path):
    app.window.dispatch_event("on_file_drop", 100, 100, [str(path)])
    app.window.dispatch_events()
    app.run(app.frame_count + 2)


@pytest.mark.gl
def test_a_folder_that_is_dropped_is_trained_and_its_model_shown(
    app, photos, monkeypatch, ball_file
):
    monkeypatch.setattr(train_job, "CODE", works(ball_file))
    drop(app, photos)
    assert isinstance(app.questions.dialog, TrainOffer) and app.questions.dialog.data == photos
    offer = app.questions.dialog
    app.watcher.begin_offered()
    job = app.train_job
    assert app.questions.dialog is None
    app.run(app.frame_count + 1)  # which may see its end
    ended(job)
    app.run(app.frame_count + 3)
    assert app.train_job is None
    assert app.scene.name == offer.output.stem and Path(app.preferences.recent[0]) == offer.output


def frames_until(app, condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        app.run(app.frame_count + 1)


@pytest.fixture
def watched(app, photos, monkeypatch, ball_file):
    """The App while a run that it has begun waits, with a snapshot."""
    monkeypatch.setattr(train_job, "CODE", works(ball_file, waits=True))
    drop(app, photos)
    app.watcher.begin_offered()
    return app


@pytest.mark.gl
def test_a_run_that_the_viewer_begins_is_watched(watched):
    app, job, settings, first = watched, watched.train_job, watched.scene.settings, watched.scene
    accumulates = settings.accumulate
    frames_until(app, lambda: app.scene is not first)
    assert app.scene.settings is settings and not settings.accumulate and app.autosave is None
    scene = app.scene
    scene.handles.grab(int(scene.handles.control_ids[0]))
    scene.handles.release()
    job.pause(False)
    frames_until(app, lambda: app.train_job is None)
    assert job.code == 0 and app.scene is scene and scene.source == job.output  # it was touched
    assert settings.accumulate == accumulates and app.autosave is not None


@pytest.mark.gl
def test_what_was_done_to_another_model_stays_until_the_run_is_over(watched):
    app, job, scene = watched, watched.train_job, watched.scene
    scene.handles.grab(int(scene.handles.control_ids[0]))
    scene.handles.release()
    frames_until(app, lambda: not app.watcher._watching)
    assert app.scene is scene
    job.pause(False)
    frames_until(app, lambda: app.scene is not scene)
    assert app.scene.source == job.output


@pytest.mark.gl
def test_a_model_that_is_opened_meanwhile_is_left_alone(watched, ball_file):
    app, job, first = watched, watched.train_job, watched.scene
    accumulates = app.scene.settings.accumulate
    frames_until(app, lambda: app.scene is not first)
    app.opening.asked = ball_file
    frames_until(app, lambda: app.scene.source == ball_file)
    frames_until(app, lambda: not app.watcher._watching)
    assert app.scene.settings.accumulate == accumulates
    job.pause(False)
    frames_until(app, lambda: app.scene.source == job.output)


@pytest.mark.gl
def test_a_run_that_fails_says_why_and_the_scene_stays(app, photos, monkeypatch):
    monkeypatch.setattr(train_job, "CODE", FAILS)
    scene = app.scene
    drop(app, photos)
    app.watcher.begin_offered()
    ended(app.train_job)
    app.run(app.frame_count + 2)
    assert app.scene is scene and "too few photographs" in app.recorder.message


@pytest.mark.gl
def test_the_offer_is_answered_with_the_mouse(app, photos, monkeypatch):
    from imgui_bundle import imgui

    began = []
    monkeypatch.setattr(app.watcher, "begin_offered", lambda: began.append(app))
    places = {}
    button = imgui.button

    def noted(label, *rest):
        pressed = button(label, *rest)
        places[label] = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        return pressed

    monkeypatch.setattr(imgui, "button", noted)
    drop(app, photos)
    app.run(app.frame_count + 2)
    low, high = places["Train"]
    at = int(0.5 * (low.x + high.x)), app.window.height - 1 - int(0.5 * (low.y + high.y))
    for event in (("on_mouse_motion", *at, 0, 0), ("on_mouse_press", *at, 1, 0)):
        app.window.dispatch_event(*event)
        app.window.dispatch_events()
        app.run(app.frame_count + 1)
    app.window.dispatch_event("on_mouse_release", *at, 1, 0)
    app.window.dispatch_events()
    app.run(app.frame_count + 2)
    assert began == [app] and app.questions.dialog is None


def test_a_stage_that_begins_anew_has_no_steps_backwards():
    job = TrainJob.__new__(TrainJob)  # runs nothing
    rates = []
    for step, seconds in ((10, 1.0), (40, 2.0), (16, 3.0), (36, 4.0)):
        job.note({"event": "step", "stage": 2, "step": step, "seconds": seconds})
        rates.append(job.steps_per_second)
    assert rates == [0.0, 30.0, 30.0, 20.0]
