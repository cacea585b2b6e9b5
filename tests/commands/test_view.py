"""The command: what it refuses, and its runs without a display, in files that a player opens."""

import json
import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import av
import numpy as np
import pytest
from PIL import Image

from deformrf.commands import view as command


def run(*arguments, env=None, timeout=120):
    """deformrf view in a process of its own, without a display."""
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
    assert command.main([str(a) for a in arguments]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("deformrf view: ")
    assert err.count("\n") == 1
    return err


def test_a_missing_model_is_named(capfd, tmp_path):
    assert "nowhere.npz" in refused(capfd, tmp_path / "nowhere.npz")


def test_a_demo_is_a_bundled_model(capfd, tmp_path):
    assert "--demo is 'mouse'; it is one of helmet, fox" in refused(capfd, "--demo", "mouse")
    assert "leave it out" in refused(capfd, tmp_path / "a.npz", "--demo", "fox")


def test_a_file_that_is_no_model_is_refused(capfd, tmp_path):
    (tmp_path / "text.npz").write_text("not a model")
    assert "not a model file" in refused(capfd, tmp_path / "text.npz")


def test_photographs_are_answered_with_the_command_that_trains(capfd, tmp_path):
    folder = tmp_path / "my toy"
    folder.mkdir()
    (folder / "a.jpg").write_bytes(b"")
    (tmp_path / "b.mp4").write_bytes(b"")
    without = "--headless", "--screenshot", tmp_path / "x.png"  # a window, which would ask
    assert f"deformrf train '{folder}' -o model.npz" in refused(capfd, folder, *without)
    assert f"deformrf train {tmp_path / 'b.mp4'}" in refused(capfd, tmp_path / "b.mp4", *without)


@pytest.mark.parametrize("layout", ["blender", "transforms.json", "colmap", "polycam", "record3d"])
def test_a_data_set_is_answered_with_the_command_that_trains(
    capfd, tmp_path, layout, write_dataset
):
    import posed_data

    folder = tmp_path / "my toy"
    if layout == "blender":
        for split in ("train", "test"):  # two folders of photographs
            write_dataset(folder, [Image.new("RGB", (8, 8))] * 2, split)
    elif layout == "transforms.json":
        posed_data.transforms(folder, **posed_data.PHONE)
    else:
        getattr(posed_data, layout)(folder)
    given = [folder, *sorted(folder.glob("transforms*.json"))]
    for path in given:
        said = refused(capfd, path)
        assert "is a data set, photographs with their cameras, not a model" in said
        assert f"deformrf train '{folder}' -o model.npz" in said


def test_a_recording_of_record3d_is_to_be_unzipped(capfd, tmp_path):
    (tmp_path / "scan.r3d").write_bytes(b"PK")
    assert "unzip it (it is a zip), and give that folder to deformrf train" in refused(
        capfd, tmp_path / "scan.r3d"
    )


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
        (["--object-size", "-1"], "--object-size is -1.0: it has to be from 0.0001 to 10000 m"),
        (["--transparent"], "it needs --screenshot"),
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
    assert "the model has 0 to" in done.stderr


def test_without_a_display_it_says_what_to_do(ball_file):
    done = run(ball_file)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "--headless" in done.stderr


@pytest.mark.gl
@pytest.mark.parametrize("step", ["load", "frame"])
def test_a_missing_optional_package_is_named(capfd, monkeypatch, window, ball_file, tmp_path, step):
    """At the start as in a frame."""
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    def lacking(*_, **__):
        raise ModuleNotFoundError("No module named 'torch.nn'", name="torch.nn")

    monkeypatch.setattr(App, step, lacking)
    monkeypatch.setattr(
        command, "_open", lambda chosen, kept: App(*window, EventLog(False), gui=False)
    )
    said = refused(
        capfd, ball_file, "--headless", "--device", "cpu", "--screenshot", tmp_path / "a.png"
    )
    assert 'torch, which trains models, is not installed: pip install ".[train]"' in said


def test_a_missing_module_of_the_program_itself_keeps_its_traceback(monkeypatch):
    def broken(chosen):
        import deformrf.viewer.no_such_module  # noqa: F401

    monkeypatch.setattr(command, "prepare", broken)
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        command.main([])


def test_help_is_quick_and_imports_nothing_slow():
    code = (
        "import sys; from deformrf.commands import view;"
        "print(*{'torch', 'warp', 'pyglet', 'moderngl', 'av'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
    done = run("--help")
    assert done.returncode == 0
    for word in ("--headless", "400x400", "1200x800"):
        assert word in done.stdout


@pytest.mark.parametrize(
    "compiling, message",
    [
        ({"marching"}, "kernels, 1 of 9 (on the first start only) ...\n"),
        (set(), "the solver ...\n"),
    ],
)
def test_a_slow_start_tells_of_compiling_only_while_it_compiles(
    capfd, monkeypatch, compiling, message
):
    stage = message.split(" (on")[0].removesuffix(" ...\n")
    progress = SimpleNamespace(stage=stage, compiling=compiling)
    monkeypatch.setattr(command, "SLOW_START", 0.0)
    with command.told_if_slow(SimpleNamespace(progress=progress)):
        time.sleep(0.1)
    assert capfd.readouterr().err == message


def test_options_have_at_most_twelve_fields():
    from dataclasses import fields

    assert len(fields(command.ViewArguments)) <= 12
    assert len(fields(command.RunArguments)) <= 12


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
def test_a_transparent_picture_of_a_mode_is_the_field_alone(ball_file, tmp_path, window):
    shot = tmp_path / "a.png"
    arguments = ("--headless", "--frames", 1, "--size", "80x64", "--device", "cpu")
    done = run(ball_file, *arguments, "--mode", "tets", "--transparent", "--screenshot", shot)
    assert done.returncode == 0, done.stderr
    picture = np.asarray(Image.open(shot))
    assert picture.shape == (64, 80, 4)
    assert set(np.unique(picture[..., 3])) == {0, 255}
    assert (picture[picture[..., 3] == 0] == 0).all()
    assert picture[picture[..., 3] == 255][:, :3].min() >= 64  # colors of tets, no red handles


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
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_and_sigterm_finish_the_clip(ball_file, tmp_path, window, sent):
    """Not all frames are in it, and its name says so."""
    clip = tmp_path / "a.mp4"
    arguments = "--headless --frames 100000 --log-events --device cpu --size 64x64".split()
    process = subprocess.Popen(
        [sys.executable, "-m", "deformrf.viewer", ball_file, *arguments, "--record", clip],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        # A shell starts what it runs in the background with SIGINT ignored, nohup with SIGHUP,
        # tests included.
        preexec_fn=lambda: signal.signal(
            signal.SIGINT if sent == signal.SIGTERM else sent, signal.SIG_DFL
        ),
    )
    for line in process.stdout:
        if '"ready"' in line:
            break
    time.sleep(1.0)
    process.send_signal(sent)
    process.communicate(timeout=30)
    assert process.returncode == 130
    (written,) = tmp_path.iterdir()
    assert written == tmp_path / "a (cut short).mp4"
    with av.open(str(written)) as container:
        assert sum(1 for _ in container.decode(video=0)) > 5


@pytest.mark.gl
def test_the_doctor_is_still_an_option_too(window):
    done = run("--doctor", "--headless", "--device", "cpu")
    assert done.returncode == 0
    for word in ("warp-lang", "CUDA", "OpenGL", "interop", "H.264", "by PixelMannen (CC0 1.0)"):
        assert word in done.stdout
