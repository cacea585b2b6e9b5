"""Films that end before their time: by Ctrl-C, by a kill, on a full disk."""

import os
import signal
import subprocess
import sys
import time

import av
import numpy as np
import pytest
from PIL import Image

from deformrf.viewer.document import Scene, save_session, start_of


def frames_of(path):
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def started(*arguments, **options):
    """deformrf render as a process that runs."""
    clean = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    code = "import sys; from deformrf.commands.render import main; sys.exit(main())"
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments), "--device", "cpu"],
        env=clean,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def started_pictures(model, folder):
    """A film of pictures in the folder, of which some are there."""
    running = started(model, "--turntable", "600", "--size", "64x48", "-o", folder / "film")
    deadline = time.monotonic() + 60
    while len(list(folder.glob("film.part/*.png"))) < 3 and time.monotonic() < deadline:
        time.sleep(0.05)
    return running


@pytest.mark.gl
def test_a_film_whose_process_is_killed_has_no_final_name(ball_file, tmp_path):
    running = started_pictures(ball_file, tmp_path)
    running.kill()
    running.communicate()
    assert [path.name for path in tmp_path.iterdir()] == ["film.part"]


@pytest.mark.gl
def test_ctrl_c_ends_the_film_where_it_is(ball_file, tmp_path):
    running = started_pictures(ball_file, tmp_path)
    running.send_signal(signal.SIGTERM)  # as Ctrl-C, which a shell may have blocked
    out, err = running.communicate(timeout=60)
    folder = tmp_path / "film (cut short)"  # its name says so
    assert running.returncode == 130 and "interrupted" in err and f"wrote {folder}" in out
    assert list(tmp_path.iterdir()) == [folder]
    pictures = sorted(folder.iterdir())
    assert len(pictures) >= 3
    for picture in pictures:
        assert np.asarray(Image.open(picture)).shape[:2] == (48, 64)  # whole, every one


@pytest.mark.gl
def test_a_video_that_was_interrupted_can_be_played(ball_file, tmp_path):
    path = tmp_path / "film.mp4"
    running = started(
        ball_file, "--turntable", "600", "--size", "64x48", "--log-events", "-o", path
    )
    for line in running.stdout:
        if '"frame": 3' in line:
            break
    running.send_signal(signal.SIGTERM)  # as Ctrl-C, which a shell may have blocked
    running.communicate(timeout=60)
    short = tmp_path / "film (cut short).mp4"
    assert running.returncode == 130 and len(frames_of(short)) >= 1
    assert list(tmp_path.iterdir()) == [short]


@pytest.mark.gl
@pytest.mark.skipif(os.name != "posix", reason="limits of processes")
@pytest.mark.parametrize("name", ["film.mp4", "film"])
def test_a_disk_that_is_full_leaves_no_broken_file(ball_file, tmp_path, name):
    import resource

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))  # bytes

    path = tmp_path / name
    arguments = "--turntable", "2", "--size", "256x256", "-o", path
    done = started(ball_file, *arguments, preexec_fn=limit)
    _, err = done.communicate(timeout=60)
    assert done.returncode == 1
    (line,) = [line for line in err.splitlines() if "can't write" in line]
    assert str(path) in line and "Traceback" not in err
    assert line == err.splitlines()[-1]  # which the viewer shows
    left = [p for p in tmp_path.rglob("*") if p.is_file()]
    assert left == []


@pytest.mark.gl
def test_a_film_that_ends_before_its_first_frame_says_one_sentence(ball, ball_file, tmp_path):
    """Why: the viewer shows the last line."""
    scene = Scene(ball, "ball", "cpu")
    path = save_session(scene, start_of(scene), tmp_path / "s.jsonl")
    with path.open("a") as file:
        file.write('[0, "rest_bones", {"bones": [0]}]\n')
    done = started(ball_file, "--session", path, "--size", "64x48", "-o", tmp_path / "a.mp4")
    _, err = done.communicate(timeout=60)
    assert done.returncode > 0
    (line,) = [line for line in err.splitlines() if not line.startswith("Warp")]
    assert "no bone 0" in line and list(tmp_path.iterdir()) == [path]
