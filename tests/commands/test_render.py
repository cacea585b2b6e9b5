"""deformrf render --estimate: it says how long a film would take, and writes nothing."""

import json
import os
import subprocess
import sys

import pytest

CODE = "import sys; from deformrf.commands.render import main; sys.exit(main())"


def said_of(*arguments, folder):
    """What deformrf render prints in a process of its own, without a display."""
    clean = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-c", CODE, *map(str, arguments), "--device", "cpu"]
    done = subprocess.run(
        command, env=clean, cwd=folder, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.gl
@pytest.mark.usefixtures("window")
@pytest.mark.parametrize("name", ["a.mp4", "a"])
def test_an_estimate_writes_nothing(ball_file, tmp_path, name):
    film = "--turntable", "2", "--size", "64x48", "--samples", "2", "-o", name, "--estimate"
    said = said_of(ball_file, *film, folder=tmp_path)
    assert said.startswith("about ") and said.endswith(" s, 60 frames\n"), said
    said = said_of(ball_file, *film, "--log-events", folder=tmp_path)
    (event,) = map(json.loads, said.splitlines())
    assert (event["event"], event["frames"]) == ("estimate", 60) and event["seconds"] > 0.0
    assert not list(tmp_path.iterdir())
