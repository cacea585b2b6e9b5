"""The Record button marks a part of a session, of which a process of its own makes a film."""

import time
from types import SimpleNamespace

import av
import numpy as np
import pytest

from deformrf.viewer.actions import ACTIONS
from deformrf.viewer.document import Session, load_session
from deformrf.viewer.films import FilmChoices, film_job

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    """An App with panels in a window without a display, that shows a ball."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))  # sessions that are kept
    made = App(*window, EventLog(False))
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.5
    yield made
    made.close()


def test_a_name_that_is_too_long_is_a_sentence(app):
    app.takes.ask()
    app.takes.choices.name = "a" * 5000
    app.takes.start_film()
    assert app.takes.asking and "too long" in app.takes.problem


def test_a_name_without_a_file_is_a_sentence(app):
    app.takes.ask()
    for name in ("/", "."):
        app.takes.choices.name = name
        app.takes.start_film()
        assert app.takes.asking and app.takes.problem


def press(app, modifiers=0):
    from pyglet.window import key

    app.window.dispatch_event("on_key_press", key.F9, modifiers)
    app.window.dispatch_events()


def frames(app, count=2):
    app.run(app.frame_count + count)


@pytest.fixture
def taken(app):
    """The App after a take of half a second, in the middle of which a vertex was dragged."""
    scene = app.scene
    for tick in range(70):
        if tick == 20:
            press(app)
        if tick == 30:
            scene.handles.grab(int(scene.handles.control_ids[0]))
        if 30 <= tick < 45:
            scene.handles.drag_to(np.add(scene.handles.grabbed.target.place, [0.0, 0.0, 0.01]))
        if tick == 50:
            press(app)
        scene.clock.advance(1 / 60)
    app.takes.choices = FilmChoices("film", "as the window", 15, 1, what="take")
    return app


def until(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def film_frames(path):
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def test_a_take_is_made_into_a_film(taken, tmp_path, capfd):
    """From the two presses of F9 on; the viewer draws frames meanwhile."""
    takes = taken.takes
    assert takes.take == (20, 50) and takes.film_seconds("take") == 0.5
    assert takes.asking and not takes.recording and taken.recorder.video is None
    frames(taken)  # the window can be drawn
    takes.start_film()
    assert not takes.asking
    for _ in range(3):
        frames(taken)
    until(lambda: frames(taken) or takes.job is None)
    path = tmp_path / "film.mp4"
    assert f"wrote {path}" in capfd.readouterr().out
    shown = film_frames(path)
    assert len(shown) == 9 and shown[0].shape == (*taken.size[::-1], 3)
    assert abs(shown[0].astype(int) - shown[-1]).max() > 20  # it moved
    assert sorted(p.name for p in tmp_path.glob("film*")) == ["film.jsonl", "film.mp4"]
    assert load_session(tmp_path / "film.jsonl", taken.scene.field).ticks >= 70


def test_a_viewer_that_closes_ends_the_film_where_it_is(taken, tmp_path, monkeypatch):
    takes = taken.takes
    takes.choices.fps, takes.choices.samples = 60, 16  # which takes a while
    takes.start_film()
    job = takes.job
    until(lambda: job.frame >= 3)  # that are drawn; the last one may not be encoded
    takes.close()
    assert job.ended and takes.job is None and not job.problem
    assert job._process.returncode is not None
    count = len(film_frames(tmp_path / "film (cut short).mp4"))
    assert 2 <= count < 31
    names = ["film (cut short).mp4", "film.jsonl"]
    assert sorted(p.name for p in tmp_path.glob("film*")) == names


def test_a_film_that_fails_says_why(taken, capfd, monkeypatch):
    taken.takes.choices.name = "film"
    (film := taken.takes.choices.path).mkdir()  # is there already
    taken.takes.start_film()
    assert taken.takes.job is None and f"{film} is there already" in capfd.readouterr().err
    film.rmdir()
    monkeypatch.setattr(FilmChoices, "arguments", lambda *_: ["--size", "9x9", "-o", str(film)])
    taken.takes.start_film()
    until(lambda: taken.takes.update() or taken.takes.job is None)
    assert "--size is 9x9" in capfd.readouterr().err
    assert not film.exists()


def test_a_session_beside_a_film_takes_the_place_of_no_other(taken, tmp_path, monkeypatch):
    taken.takes.choices = FilmChoices("run.v2", "as the window", 15, 1, format="PNG files")
    for name in ("run.jsonl", "run.v2.jsonl"):
        (tmp_path / name).write_text("mine")
    monkeypatch.setattr(FilmChoices, "arguments", lambda *_: ["--size", "9x9"])
    taken.takes.start_film()
    for name in ("run.jsonl", "run.v2.jsonl"):
        assert (tmp_path / name).read_text() == "mine"
    assert load_session(tmp_path / "run.v2-2.jsonl", taken.scene.field).ticks >= 70


def test_a_film_whose_process_talks_nonsense_ends_with_it(taken, monkeypatch):
    """Nobody reads what else it prints, so it would stand for ever."""
    code = "import time; print('{\"event\" is no JSON', flush=True); time.sleep(600)"
    monkeypatch.setattr(film_job, "CODE", code)
    taken.takes.start_film()
    job = taken.takes.job
    until(lambda: job.ended)
    assert "can't be rendered" in job.problem and job._process.returncode is not None


def test_a_take_is_of_the_model_that_is_shown(taken, ball):
    """Another model has no such ticks."""
    taken.load(ball, "another", "cpu")
    assert taken.takes.take is None and not taken.takes.asking
    assert (
        taken.questions.left_behind is not None
    )  # the work on the one before, which is asked about
    taken.questions.left_behind = None
    press(taken)
    assert taken.takes.recording
    taken.playing.play(Session({"start": {}, "ticks": 3}, []))
    assert not taken.takes.recording


def test_a_take_ends_with_the_scene_it_was_of(app):
    press(app)
    assert app.takes.recording
    app.scene.journal.clear()
    frames(app)
    assert app.takes.recording  # from tick 0 on
    app.scene.clock.advance(0.1)
    press(app)
    press(app)
    app.scene.journal.clear()  # as a session that is opened does
    assert not app.takes.recording
    frames(app)


def test_without_a_take_all_of_the_session_is_offered(app):
    from pyglet.window import key

    app.scene.clock.advance(0.1)
    press(app, key.MOD_CTRL)
    assert app.takes.asking and app.takes.choices.what == "all"
    assert app.takes.film_seconds("all") == app.scene.journal.tick / 60


def test_recording_costs_a_frame_nothing(app):
    """No pixel is read: a take is two numbers."""
    read = []
    app.canvas.read, kept = lambda *_: read.append(1), app.canvas.read
    press(app)
    frames(app, 3)
    assert app.takes.recording and not read
    app.canvas.read = kept


def test_enter_renders_and_escape_does_not(taken, tmp_path, monkeypatch):
    """Enter plays no timeline meanwhile, whatever was clicked on before."""
    from pyglet.window import key, mouse

    def send(symbol):
        taken.window.dispatch_event("on_key_press", symbol, 0)
        frames(taken)
        taken.window.dispatch_event("on_key_release", symbol, 0)
        frames(taken)

    frames(taken)
    send(key.ESCAPE)
    assert not taken.takes.asking and taken.takes.job is None
    press(taken, key.MOD_CTRL)
    taken.takes.choices.name = "again"
    played = []
    monkeypatch.setitem(ACTIONS, "play", played.append)
    frames(taken)
    for name in ("on_mouse_press", "on_mouse_release"):  # beside it
        taken.window.dispatch_event(name, 5, 5, mouse.LEFT, 0)
        frames(taken)
    taken.recorder.say("something else")  # whose window takes nothing away
    frames(taken)
    send(key.RETURN)
    assert not played
    assert not taken.takes.asking and taken.takes.job is not None
    assert (tmp_path / "again.jsonl").exists()


@pytest.mark.parametrize(
    "format, name", [("MP4 (H.264)", "a.mp4"), ("WebP", "a.webp"), ("PNG files", "a")]
)
def test_choices_are_arguments_of_the_command(format, name, tmp_path, monkeypatch):
    from deformrf.commands import options
    from deformrf.commands.render import RenderArguments, check

    monkeypatch.chdir(tmp_path)
    choices = FilmChoices("a", "1280x720", 24, 16, blur=True, format=format, transparent=True)
    choices.what = "take"
    arguments = choices.arguments((33, 44), tmp_path / "s.jsonl", (2, 5))
    arguments += ["-o", str(choices.path)]
    parsed = options.parsed("deformrf render", RenderArguments, arguments)
    assert check(parsed) == (1280, 720)
    assert (parsed.fps, parsed.samples, parsed.shutter) == (24, 16, 0.5)
    assert parsed.output == tmp_path / name and parsed.hide_handles
    assert (parsed.session, parsed.first, parsed.last) == (tmp_path / "s.jsonl", 2, 5)
    assert parsed.transparent == (name != "a.mp4")


# -- what is offered ---------------------------------------------------------------------------


def test_a_film_of_nothing_is_not_offered(app, capfd):
    takes = app.takes
    takes.ask()
    assert takes.choices.what == "turntable"
    reasons = [takes.why_not(what) for what in ("take", "all", "timeline", "turntable")]
    assert reasons == ["nothing was recorded", "nothing was done yet", "it has no keys", ""]
    frames(app)
    takes.ask("timeline")
    takes.start_film()
    assert takes.job is None and "it has no keys" in takes.problem
    takes.asking = False
    press(app)
    press(app)
    assert not takes.asking and "the take has no tick" in capfd.readouterr().err


def test_a_take_that_an_undo_has_shortened_is_not_offered(taken):
    taken.scene.journal.tick = 40
    assert taken.takes.why_not("take") == "the take has no tick"
    taken.takes.ask()
    assert taken.takes.choices.what == "all"


def test_a_turn_shows_the_object_as_it_is_now(taken, tmp_path, capfd):
    """Its first frame, from where the view is, in the pose at the end of the session."""
    from deformrf.core.render import Renderer
    from deformrf.viewer.camera import orbit as orbits

    scene, takes = taken.scene, taken.takes
    scene.handles.grab(int(scene.handles.control_ids[0]))
    for _ in range(20):
        scene.handles.drag_to(np.add(scene.handles.grabbed.target.place, [0.0, 0.0, 0.02]))
        scene.clock.advance(1 / 60)
    scene.orbit = orbits.turned(scene.orbit, 30.0, 3.0, 64)
    takes.choices = FilmChoices(
        "turn", "as the window", 15, 1, format="PNG files", what="turntable", turn_seconds=1.0
    )
    takes.start_film()
    pose = scene.solver.vertices.numpy().copy()
    until(lambda: takes.update() or takes.job is None)
    pictures = sorted((tmp_path / "turn").iterdir())
    assert len(pictures) == 15, capfd.readouterr().err
    renderer = Renderer(scene.field, "cpu")
    renderer.set_vertices(pose)
    live = renderer.render(orbits.camera_of(scene.orbit, *taken.size)).color_array()[..., :3]
    from PIL import Image

    first, later = (np.asarray(Image.open(pictures[n]).convert("RGB"), int) for n in (0, 4))
    assert abs(first - live).max() <= 2 and abs(later - live).max() > 50


def test_a_film_of_the_timeline(taken, tmp_path, capfd):
    from dataclasses import asdict

    scene, takes = taken.scene, taken.takes
    for tick in (0, 30):
        scene.timeline.key(tick, asdict(scene.orbit), True)
    takes.choices = FilmChoices("t", "as the window", 10, 1, what="timeline")
    assert takes.film_seconds("timeline") == 0.5
    takes.start_film()
    until(lambda: takes.update() or takes.job is None)
    assert len(film_frames(tmp_path / "t.mp4")) == 6, capfd.readouterr().err


def test_a_folder_that_cannot_be_is_told_and_a_good_one_remembered(taken, tmp_path):
    (tmp_path / "file").touch()
    taken.takes.asking, taken.takes.choices.folder = True, "file"
    taken.takes.start_film()
    assert taken.takes.job is None and f"can't write {tmp_path / 'file'}" in taken.takes.problem
    taken.takes.choices.folder, taken.takes.choices.name = "films", "film"
    taken.takes.start_film()
    assert taken.preferences.film_folder == "films"
    until(lambda: taken.takes.update() or taken.takes.job is None)
    assert (tmp_path / "films" / "film.mp4").exists()


def test_a_size_beyond_the_limits_starts_nothing(taken):
    taken.takes.choices.size, taken.takes.choices.free_size = "free", (9000, 30)
    taken.takes.start_film()
    assert taken.takes.job is None and "32 to 8192" in taken.takes.problem


def test_the_dialog_says_how_long_the_film_takes(taken, tmp_path):
    takes = taken.takes
    takes.ask("take")
    takes.choices.size, takes.choices.free_size = "free", (65, 48)
    until(lambda: frames(taken, 1) or takes.estimator.job is not None)
    first = takes.estimator.job
    takes.choices.fps = 60
    frames(taken, 1)
    assert first.stopping and takes.estimator.line == "estimating ..."
    until(lambda: frames(taken, 1) or takes.estimator.line.startswith("about "))
    assert takes.estimator.line.endswith(" s, 31 frames")
    assert takes.estimator.job is not first and not list(tmp_path.glob("*.mp4"))
    takes.asking = False
    frames(taken, 1)
    assert takes.estimator.line == "" and takes.estimator.job.stopping
    scratch = takes._scratch()
    takes.close()
    assert not scratch.exists()


def test_the_frame_of_the_film_lies_over_the_view(app):
    """It is shown with the dialog, and without it where that is chosen."""
    from deformrf.viewer.panels import window

    drawn = []
    overlay, window.frame_overlay = window.frame_overlay, drawn.append
    try:
        frames(app)
        assert not drawn
        app.takes.shows_frame, app.takes.choices.size = True, "1080x1080"
        frames(app, 1)
    finally:
        window.frame_overlay = overlay
    ((_, _, width, height),) = drawn
    assert width == height <= app.window.height
    frames(app)


def test_the_button_that_ends_a_film_stays_where_it_is(app, monkeypatch):
    """Also when the film's second frame says how long it takes."""
    from imgui_bundle import imgui

    places, button = [], imgui.small_button

    def placed(label):
        pressed = button(label)
        if label == "End it here":
            low = imgui.get_item_rect_min()
            places.append((low.x, low.y))
        return pressed

    monkeypatch.setattr(imgui, "small_button", placed)
    job = SimpleNamespace(frame=0, count=0, seconds_left=None, ended=False, close=lambda: None)
    app.takes.job = job
    frames(app, 4)
    job.frame, job.count, job.seconds_left = 2, 90, 1000.0
    frames(app, 4)
    assert len(places) > 6 and places[-1] == places[3]
    app.takes.job = None
