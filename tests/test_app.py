"""The program without a display: the same loop, synthetic events, files that a player opens."""

import json
import os
import signal
import subprocess
import sys
import time

import av
import numpy as np
import pytest
from PIL import Image

from deformrf.viewer import app as program
from deformrf.viewer import options, picking


def run(*arguments, env=None, timeout=120):
    """deformrf-view in a process of its own, without a display."""
    clean = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.run(
        [sys.executable, "-m", "deformrf.viewer", *map(str, arguments)],
        env={**clean, **(env or {})},
        capture_output=True,
        text=True,
        timeout=timeout,
    )


# -- what can be wrong -----------------------------------------------------------------------


def refused(capfd, *arguments):
    """The one sentence that these arguments end in."""
    assert program.main([str(a) for a in arguments]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("deformrf-view: ")
    assert err.count("\n") == 1
    return err


def test_a_missing_model_is_named(capfd, tmp_path):
    assert "nowhere.npz" in refused(capfd, tmp_path / "nowhere.npz")


def test_a_file_that_is_no_model_is_refused(capfd, tmp_path):
    (tmp_path / "text.npz").write_text("not a model")
    assert "not a model file" in refused(capfd, tmp_path / "text.npz")


def test_a_model_of_another_version_is_refused(capfd, tmp_path, ball_file):
    with np.load(ball_file) as archive:
        arrays = dict(archive)
    meta = json.loads(arrays["meta"].tobytes()) | {"format_version": 99}
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    np.savez(tmp_path / "new.npz", **arrays)
    assert "version 99" in refused(capfd, tmp_path / "new.npz")


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (["--headless", "--frames", "0"], "--frames is 0"),
        (["--headless", "--size", "800"], "write it as in 800x600"),
        (["--headless", "--size", "8x600"], "both sides have to be 32 to 8192"),
        (["--headless", "--drag", "seven", "--record", "a.mp4"], "VERTEX:DX,DY,DZ"),
        (["--drag", "7:0,0,1"], "needs --headless"),
        (["--headless", "--record", "clip.avi"], "has to end in .mp4"),
        (["--headless", "--screenshot", "shot.jpg"], "has to end in .png"),
        (["--headless", "--fps", "0"], "--fps is 0"),
        (["--headless", "--frames", "9"], "it needs --record or --screenshot"),
    ],
)
def test_an_argument_that_makes_no_sense_is_explained(capfd, ball_file, arguments, sentence):
    assert sentence in refused(capfd, ball_file, *arguments)


@pytest.mark.parametrize("option, name", [("--record", "a.mp4"), ("--screenshot", "a.png")])
def test_a_file_that_cannot_be_written_is_named(capfd, ball_file, tmp_path, option, name):
    (tmp_path / "file").write_text("no folder")
    path = tmp_path / "file" / name
    sentence = refused(capfd, ball_file, "--headless", option, path)
    assert f"can't write {path}: " in sentence
    assert "Errno" not in sentence


@pytest.mark.gl
def test_a_vertex_that_the_model_has_not_is_refused(window, ball_file, tmp_path):
    arguments = ("--headless", "--device", "cpu", "--screenshot", tmp_path / "a.png")
    done = run(ball_file, *arguments, "--drag", "999:0,0,1")
    assert done.returncode == 2
    assert "the model has 0 to 131" in done.stderr


def test_without_a_display_it_says_what_to_do(ball_file):
    done = run(ball_file)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "--headless" in done.stderr


def test_help_is_quick_and_imports_nothing_slow():
    code = (
        "import sys; from deformrf.viewer import app, options; options.parse(['x.npz']);"
        "print(*{'torch', 'warp', 'pyglet', 'moderngl', 'av'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
    done = run("--help")
    assert done.returncode == 0
    for word in ("--headless", "400x400", "1200x800"):
        assert word in done.stdout


def test_the_version_is_printed(capfd):
    assert program.main(["--version"]) == 0
    assert capfd.readouterr().out.startswith("deformrf ")


def test_options_have_at_most_twelve_fields():
    from dataclasses import fields

    assert len(fields(options.ViewArguments)) <= 12
    assert len(fields(options.RunArguments)) <= 12


# -- headless --------------------------------------------------------------------------------


@pytest.mark.gl
def test_a_headless_drag_is_recorded(ball_file, tmp_path, window):
    clip, shot = tmp_path / "a.mp4", tmp_path / "a.png"
    done = run(
        *(ball_file, "--headless", "--frames", 12, "--drag", "118:0.2,0,0.1", "--size", "161x121"),
        *("--record", clip, "--screenshot", shot, "--device", "cpu"),
    )
    assert done.returncode == 0, done.stderr
    assert str(clip) in done.stdout
    assert str(shot) in done.stdout
    with av.open(str(clip)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert stream.average_rate == 30
        assert float(stream.duration * stream.time_base) == pytest.approx(12 / 30)
    assert len(frames) == 12
    assert frames[0].shape == (120, 160, 3)
    bent, first = frames[7].astype(int), frames[0].astype(int)
    assert (abs(bent - first).max(axis=-1) > 60).mean() > 0.03
    picture = np.asarray(Image.open(shot))
    assert picture.shape == (121, 161, 3)
    assert abs(picture[:120, :160].astype(int) - bent).mean() < 8  # both before the release


@pytest.mark.gl
def test_two_headless_runs_are_the_same_picture(ball_file, tmp_path, window):
    pictures = []
    for name in ("a.png", "b.png"):
        arguments = ("--headless", "--frames", 4, "--drag", "118:0.1,0,0", "--device", "cpu")
        done = run(ball_file, *arguments, "--size", "80x64", "--screenshot", tmp_path / name)
        assert done.returncode == 0, done.stderr
        pictures.append(np.asarray(Image.open(tmp_path / name)))
    assert np.array_equal(*pictures)


@pytest.mark.gl
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_finish_the_clip(ball_file, tmp_path, window, sent):
    clip = tmp_path / "a.mp4"
    arguments = "--headless --frames 100000 --log-events --device cpu --size 64x64".split()
    process = subprocess.Popen(
        [sys.executable, "-m", "deformrf.viewer", ball_file, *arguments, "--record", clip],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    for line in process.stdout:
        if '"ready"' in line:
            break
    time.sleep(1.0)
    process.send_signal(sent)
    process.communicate(timeout=30)
    assert process.returncode == 130
    with av.open(str(clip)) as container:
        assert sum(1 for _ in container.decode(video=0)) > 5
    assert list(tmp_path.iterdir()) == [clip]


@pytest.mark.gl
def test_the_doctor_names_what_it_found(window):
    done = run("--doctor", "--headless")
    assert done.returncode == 0
    for word in ("warp-lang", "CUDA", "OpenGL", "interop", "H.264"):
        assert word in done.stdout


# -- the window's own loop, with panels ------------------------------------------------------


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    """An App with panels in a window without a display, ready, with its events in `log`."""
    from deformrf.viewer.loop import App

    class Log(list):
        enabled = False

        def __call__(self, event, **fields):
            self.append((event, fields))

    monkeypatch.chdir(tmp_path)
    made = App(*window, Log())
    made.load(ball, "ball", "cpu")
    made.scene.settings.automatic_resolution = False
    made.scene.settings.fixed_resolution = 0.5
    frames(made, 3)
    yield made
    made.close()


def frames(app, count):
    app.run(app._frame_count + count)


def send(app, name, *arguments):
    app.window.dispatch_event(name, *arguments)
    app.window.dispatch_events()


def view_point(app, vertex):
    """A vertex in pyglet's coordinates."""
    camera = app.controls.camera
    (at,), _ = picking.project(camera, app.scene.positions[vertex][None])
    return round(at[0]), round(app.window.height - 1 - at[1])


def free_vertex(app):
    """A visible control vertex that no panel covers."""
    for vertex in app.scene.control_ids[app.controls.shown()]:
        if not app.gui.covers(*view_point(app, vertex)):
            return int(vertex)
    pytest.fail("the panel covers every vertex")


@pytest.fixture
def bare(app):
    """The same without panels in the way."""
    app.scene.settings.show_panel = False
    frames(app, 2)
    return app


@pytest.mark.gl
def test_pressing_and_moving_bends_the_object(bare):
    from pyglet.window import mouse

    vertex = free_vertex(bare)
    x, y = view_point(bare, vertex)
    send(bare, "on_mouse_motion", x, y, 0, 0)
    assert bare.scene.hover == vertex
    send(bare, "on_mouse_press", x, y, mouse.LEFT, 0)
    send(bare, "on_mouse_drag", x + 20, y + 15, 20, 15, mouse.LEFT, 0)
    time.sleep(0.04)
    frames(bare, 3)
    assert view_point(bare, vertex) == pytest.approx((x + 20, y + 15), abs=1)
    send(bare, "on_mouse_release", x + 20, y + 15, mouse.LEFT, 0)
    assert [name for name, _ in bare.log][-2:] == ["grab", "release"]


@pytest.mark.gl
def test_the_panel_names_the_vertex_under_the_mouse_and_the_one_held(bare):
    from pyglet.window import mouse

    from deformrf.viewer.panels.deform import vertex_line

    vertex = free_vertex(bare)
    at = view_point(bare, vertex)
    assert vertex_line(bare.scene) == "no vertex under the mouse"
    send(bare, "on_mouse_motion", *at, 0, 0)
    assert vertex_line(bare.scene) == f"vertex {vertex}"
    send(bare, "on_mouse_press", *at, mouse.LEFT, 0)
    assert vertex_line(bare.scene) == f"holding vertex {vertex}"
    send(bare, "on_mouse_release", *at, mouse.LEFT, 0)


@pytest.mark.gl
def test_escape_ends_the_drag_and_not_the_program(bare):
    from pyglet.window import key, mouse

    x, y = view_point(bare, free_vertex(bare))
    send(bare, "on_mouse_press", x, y, mouse.LEFT, 0)
    assert bare.scene.grabbed is not None
    send(bare, "on_key_press", key.ESCAPE, 0)
    assert bare.scene.grabbed is None
    assert not bare.window.has_exit
    send(bare, "on_key_press", key.Q, key.MOD_CTRL)
    assert bare.window.has_exit


@pytest.mark.gl
def test_a_press_on_the_panel_stays_there(app):
    from pyglet.window import mouse

    orbit = app.scene.orbit
    inside = 60, app.window.height - 60
    assert app.gui.covers(*inside)
    send(app, "on_mouse_press", *inside, mouse.LEFT, 0)
    send(app, "on_mouse_drag", 70, 100, 10, -80, mouse.LEFT, 0)
    send(app, "on_mouse_release", 70, 100, mouse.LEFT, 0)
    send(app, "on_mouse_scroll", *inside, 0, 3)
    assert app.scene.orbit is orbit
    assert app.scene.grabbed is None


WIDGETS = (
    *("button", "checkbox", "combo", "color_edit3", "slider_float", "slider_int"),
    "collapsing_header",
)


@pytest.fixture
def widgets(monkeypatch):
    """Everything that the panels have drawn: (label, id, middle in ImGui's coordinates)."""
    from imgui_bundle import imgui

    drawn = []

    def noted(draw):
        def draw_and_note(label, *arguments, **options):
            result = draw(label, *arguments, **options)
            low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
            at = round(0.5 * (low.x + high.x)), round(0.5 * (low.y + high.y))
            drawn.append((label, imgui.get_item_id(), at))
            return result

        return draw_and_note

    for name in WIDGETS:
        monkeypatch.setattr(imgui, name, noted(getattr(imgui, name)))
    return drawn


@pytest.mark.gl
def test_no_two_widgets_have_the_same_id(app, widgets, monkeypatch):
    from deformrf.viewer.panels import layout

    sections = tuple((title, panel, True) for title, panel, _ in layout.SECTIONS)
    monkeypatch.setattr(layout, "SECTIONS", sections)
    frames(app, 2)
    widgets.clear()
    frames(app, 1)
    ids = [identity for _, identity, _ in widgets]
    assert len(ids) > 20
    assert len(set(ids)) == len(ids)


@pytest.mark.gl
def test_the_record_button_starts_and_ends_a_clip(app, widgets, monkeypatch, tmp_path):
    from deformrf.viewer.panels import layout

    only = tuple(section for section in layout.SECTIONS if section[0] == "Record")
    monkeypatch.setattr(layout, "SECTIONS", only)  # the others would scroll it out of sight
    frames(app, 3)
    click(app, [at for label, _, at in widgets if label == "Record"][-1])
    assert app.status.recorder is not None
    frames(app, 3)
    click(app, [at for label, _, at in widgets if label == "Stop recording"][-1])
    assert app.status.recorder is None
    assert len(list(tmp_path.glob("deformrf-*.mp4"))) == 1


def click(app, at):
    """Move to a point in ImGui's coordinates, press and let go."""
    from pyglet.window import mouse

    x, y = at[0], app.window.height - 1 - at[1]
    send(app, "on_mouse_motion", x, y, 0, 0)
    frames(app, 2)
    send(app, "on_mouse_press", x, y, mouse.LEFT, 0)
    frames(app, 2)
    send(app, "on_mouse_release", x, y, mouse.LEFT, 0)
    frames(app, 2)


@pytest.mark.gl
def test_keys_do_what_the_table_says(bare):
    from pyglet.window import key

    scene = bare.scene
    send(bare, "on_key_press", key.SPACE, 0)
    assert scene.paused
    send(bare, "on_key_press", key.W, 0)
    assert scene.settings.show_wireframe
    send(bare, "on_key_press", key.TAB, 0)
    assert scene.settings.show_panel
    send(bare, "on_key_press", key.F1, 0)
    assert scene.settings.show_help
    frames(bare, 2)  # panel and help can be drawn


@pytest.mark.gl
def test_a_live_clip_lasts_as_long_as_it_was_recorded(bare, tmp_path):
    from pyglet.window import key

    send(bare, "on_key_press", key.F9, 0)
    start = time.monotonic()
    while time.monotonic() - start < 1.0:
        frames(bare, 1)
    send(bare, "on_key_press", key.F9, 0)
    seconds = time.monotonic() - start
    (clip,) = tmp_path.glob("deformrf-*.mp4")
    with av.open(str(clip)) as container:
        stream = container.streams.video[0]
        assert float(stream.duration * stream.time_base) == pytest.approx(seconds, abs=0.1)
        assert (stream.width, stream.height) == (320, 240)


@pytest.mark.gl
def test_a_screenshot_has_the_panel_only_if_asked_for(app, tmp_path):
    pictures = []
    for with_panel in (False, True):
        app.scene.settings.panel_in_screenshots = with_panel
        app.actions.screenshot()
        frames(app, 1)
        pictures.append(np.asarray(Image.open(app.capture.written[-1])).astype(int))
    plain, panel = pictures
    changed = abs(plain - panel).max(axis=-1) > 8
    assert plain.shape == (240, 320, 3)
    assert changed[:, :100].mean() > 0.1


@pytest.mark.gl
def test_handles_are_in_the_picture_only_if_asked_for(bare):
    pictures = []
    for with_handles in (True, False):
        bare.scene.settings.handles_in_clips = with_handles
        bare.actions.screenshot()
        frames(bare, 1)
        pictures.append(np.asarray(Image.open(bare.capture.written[-1])).astype(int))
    assert (abs(pictures[0] - pictures[1]).max(axis=-1) > 60).sum() > 100


@pytest.mark.gl
def test_closing_the_window_ends_the_loop(bare):
    bare.window.dispatch_event("on_close")
    bare.run()
    assert bare.window.has_exit
