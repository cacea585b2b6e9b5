"""Films of a session whose timeline plays, and of a timeline that nobody played."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from deformrf.commands import render as render_command
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.document import (
    Player,
    Scene,
    SessionError,
    load_session,
    save_session,
    start_of,
)
from deformrf.viewer.films import Film, with_timeline


@pytest.fixture
def made(ball):
    """A scene whose timeline has camera and pose keys, and what its session starts with."""
    scene = Scene(ball, "ball", "cpu")
    start, line = start_of(scene), scene.timeline
    scene.settings.grab_radius = 0.3
    line.key(0, orbits.values_of(scene.orbit), True)
    scene.handles.grab(int(scene.handles.control_ids[0]))
    scene.handles.drag_to(np.add(scene.handles.grabbed.target.place, [0.1, 0.0, 0.0]))
    scene.clock.advance(0.1)
    line.key(20, orbits.values_of(replace(scene.orbit, yaw=1.5, distance=1.5)), True)
    scene.handles.release()
    line.set_motion("physics")
    return scene, start


@pytest.mark.parametrize("loop", [False, True])
def test_a_film_shows_what_was_seen_while_the_timeline_played(ball, made, tmp_path, loop):
    """Live at 10 frames a second: the film has the ticks between them, too."""
    scene, start = made
    scene.timeline.set_loop(loop)
    scene.clock.advance(0.1)
    scene.timeline.play()
    seen = {}
    for _ in range(8):
        scene.clock.advance(0.1)
        seen[scene.journal.tick] = scene.orbit, scene.solver.vertices.numpy().copy()
    scene.note_view()
    session = load_session(save_session(scene, start, tmp_path / "s.jsonl"), ball)
    film = Film(Scene(ball, "ball", "cpu"), session, 60)
    yaws = []
    for frame in range(film.count):
        film.show(frame)
        yaws.append(film.scene.orbit.yaw)
        if frame in seen:
            orbit, vertices = seen[frame]
            assert orbits.values_of(film.scene.orbit) == orbits.values_of(orbit)
            np.testing.assert_array_equal(film.scene.solver.vertices.numpy(), vertices)
    begin = session.ticks - 48
    line = scene.timeline
    wanted = [line.orbit_at(tick).yaw for tick in range(20)]
    np.testing.assert_array_equal(yaws[begin : begin + 20], wanted)


def test_a_timeline_is_filmed_from_its_beginning_to_its_last_key(ball, made, tmp_path):
    scene, start = made
    scene.timeline.set_loop(True)
    session = load_session(save_session(scene, start, tmp_path / "s.jsonl"), ball)
    other = Scene(ball, "ball", "cpu")
    rest = other.solver.vertices.numpy().copy()
    longer, begin = with_timeline(Player(other, session))
    assert (begin, longer.ticks) == (session.ticks, session.ticks + 20)
    np.testing.assert_array_equal(other.solver.vertices.numpy(), rest)
    assert other.timeline.end == 0 and other.journal.events == []
    film = Film(other, longer, 60)
    film.cut(begin, None)
    first, last = scene.timeline.keys["pose"]
    for frame in range(film.count):
        film.show(frame)
        wanted = scene.timeline.orbit_at(frame)
        assert orbits.values_of(other.orbit) == orbits.values_of(wanted)
        if frame == 0:
            np.testing.assert_array_equal(other.solver.vertices.numpy(), first.vertices)
    now = other.solver.vertices.numpy()
    np.testing.assert_allclose(now[last.held], last.vertices[last.held], atol=1e-6)


def test_a_session_without_keys_has_no_timeline_to_film(ball, tmp_path):
    scene = Scene(ball, "ball", "cpu")
    path = save_session(scene, start_of(scene), tmp_path / "s.jsonl")
    with pytest.raises(SessionError, match="has no keys"):
        with_timeline(Player(scene, load_session(path, ball)))


def test_a_timeline_without_a_session_is_explained(capfd, ball_file, tmp_path):
    path = tmp_path / "a.mp4"
    assert (
        render_command.main([str(ball_file), "--timeline", "--turntable", "1", "-o", str(path)])
        == 2
    )
    assert "give --session too" in capfd.readouterr().err and not path.exists()


@pytest.mark.gl
def test_the_command_renders_a_timeline(ball, ball_file, made, tmp_path):
    scene, start = made
    session = save_session(scene, start, tmp_path / "s.jsonl")
    size = "--fps", "12", "--size", "48x32", "--device", "cpu"
    code = "import sys; from deformrf.commands.render import main; sys.exit(main())"
    files = ball_file, "--session", session, "-o", tmp_path / "film"
    clean = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, files), "--timeline", *size],
        env=clean,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "film").iterdir())) == 5  # 20 ticks: a third of a second
