"""Projects on the command line: they are viewed and filmed where they were moved to."""

import json
import os
import subprocess
import sys
from dataclasses import asdict

import numpy as np
import pytest
from PIL import Image

from deformrf.commands import render, view
from deformrf.core import field as fields
from deformrf.viewer.document import Scene, save_project, save_session, start_of


@pytest.fixture
def scene(ball_file):
    """A scene that has swung for a second, with a camera on the timeline."""
    made = Scene(fields.load(ball_file), "ball", "cpu")
    made.source = ball_file
    made.start = start_of(made)
    made.set_gravity(4.0)
    made.handles.set_pin(int(made.handles.control_ids[0]), True)
    made.timeline.turntable(30, asdict(made.orbit) | {"target": made.orbit.target.tolist()})
    for _ in range(30):
        made.clock.advance(1.0 / 60.0)
    return made


@pytest.fixture
def project(scene, tmp_path):
    """A project of it, without its model's file, in another folder."""
    (tmp_path / "elsewhere").mkdir()
    saved = save_project(scene, scene.start, tmp_path / "work.deformrf")
    return saved.rename(tmp_path / "elsewhere" / "moved.deformrf")


def run(command, *arguments):
    """A command in a process of its own, without a display."""
    clean = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    code = f"import sys; from deformrf.commands.{command} import main; sys.exit(main())"
    words = [sys.executable, "-c", code, *map(str, arguments), "--device", "cpu"]
    return subprocess.run(words, env=clean, capture_output=True, text=True, timeout=120)


@pytest.mark.gl
def test_a_project_is_viewed(project, scene, tmp_path, window):
    shot = tmp_path / "a.png"
    arguments = "--headless", "--frames", 1, "--size", "64x64", "--screenshot", shot
    done = run("view", project, *arguments, "--log-events")
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    ready = next(line for line in lines if line["event"] == "ready")
    assert ready["undoes"] == scene.journal.undoes
    assert ready["pinned"] == scene.solver.pinned.sum() and ready["max_displacement"] > 1e-3


@pytest.mark.gl
def test_a_project_is_filmed_like_its_model_and_session(
    project, scene, ball_file, tmp_path, window
):
    scene.source = ball_file
    session = save_session(scene, scene.start, tmp_path / "s.jsonl")
    films = []
    for name, what in (("a", [project]), ("b", [ball_file, "--session", session])):
        for option in ([], ["--timeline"]):
            folder = tmp_path / "".join([name, *option])
            arguments = *what, *option, "--size", "64x48", "--fps", 6, "-o", folder
            done = run("render", *arguments)
            assert done.returncode == 0, done.stderr
            films.append([np.asarray(Image.open(one)) for one in sorted(folder.iterdir())])
    assert len(films[0]) == len(films[2]) > 2 and len(films[1]) == len(films[3]) > 1
    np.testing.assert_array_equal(films[0], films[2])
    np.testing.assert_array_equal(films[1], films[3])


@pytest.mark.parametrize("command", [view, render], ids=["view", "render"])
def test_what_makes_no_sense_with_a_project_is_explained(command, project, tmp_path, capfd):
    files = ["-o", tmp_path / "a.mp4"] if command == render else []

    def refused(*arguments):
        assert command.main([str(word) for word in (project, *arguments, *files)]) == 2
        out, err = capfd.readouterr()
        assert out == "" and err.count("\n") == 1
        return err

    assert "has a session of its own: leave --session out" in refused("--session", "s.jsonl")
    assert "leave --object-size out" in refused("--object-size", 2)
    assert "leave it out" in refused("--demo", "fox")
    project.write_bytes(project.read_bytes()[:3000])
    assert "is not a project, or is damaged" in refused()
    project.unlink()
    assert "there is no project at" in refused()
    assert not (tmp_path / "a.mp4").exists()
