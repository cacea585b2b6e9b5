"""No command opens a socket: the program needs no network and tells nobody anything."""

import subprocess
import sys

import pytest

# Python tells its audit hooks of each socket and each name that is looked up.
PROGRAM = """
import sys

def hook(event, values):
    if event in ("socket.getaddrinfo", "socket.gethostbyname", "socket.connect", "socket.bind"):
        raise PermissionError(f"{event} {values}")

sys.addaudithook(hook)
from deformrf.commands.entry import main
sys.exit(main())
"""


def call(program, *arguments):
    command = [sys.executable, "-c", PROGRAM, program, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.mark.usefixtures("window")  # skipped where there is no OpenGL
def test_viewing_and_films_open_no_socket(ball_file, tmp_path):
    frame = ["--size", "64x48", "--device", "cpu"]
    picture, film = tmp_path / "a.png", tmp_path / "a.mp4"
    run = call("view", ball_file, "--headless", "--frames", 1, "--screenshot", picture, *frame)
    assert run.returncode == 0 and picture.stat().st_size, run.stderr
    run = call("render", ball_file, "--turntable", 0.1, "-o", film, *frame)
    assert run.returncode == 0 and film.stat().st_size, run.stderr


def test_training_opens_no_socket(write_dataset, tmp_path):
    import numpy as np
    from PIL import Image

    pixels = np.zeros((16, 16, 4), np.uint8)
    pixels[4:12, 4:12] = 200
    for split in ("train", "test"):
        write_dataset(tmp_path / "data", [Image.fromarray(pixels)] * 3, split)
    model = tmp_path / "m.npz"
    arguments = ["--preset", "tiny", "--steps", 2, "--device", "cpu", "--leave-out", "coarse-stage"]
    run = call("train", tmp_path / "data", "-o", model, *arguments)
    assert run.returncode == 0 and model.stat().st_size, run.stderr


def test_the_hook_sees_sockets():
    opened = "import socket; socket.create_connection(('localhost', 9))"
    program = PROGRAM.partition("from deformrf")[0] + opened
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "PermissionError: socket.getaddrinfo" in run.stderr
