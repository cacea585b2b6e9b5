"""Poses of a session in a program are those that the viewer's player shows."""

import numpy as np
import pytest

from deformrf.viewer.document import (
    Player,
    Scene,
    SessionError,
    load_session,
    poses,
    save_session,
    start_of,
)

TICKS = 12


@pytest.fixture
def session(ball, tmp_path):
    """A control point is dragged, let go of, and swings."""
    scene = Scene(ball, "ball", "cpu")
    start = start_of(scene)
    scene.handles.grab(int(scene.handles.control_ids[0]))
    place = scene.handles.grabbed.target.place
    for tick in range(TICKS):
        if tick == TICKS // 2:
            scene.handles.release()
        elif tick < TICKS // 2:
            scene.handles.drag_to(np.add(place, (0.0, 0.02 * tick, 0.0)))
        scene.clock.advance(1 / 60)
    return save_session(scene, start, tmp_path / "s.jsonl"), scene.positions.copy()


@pytest.mark.parametrize("every", [1, 5])
def test_poses_are_those_of_the_player(session, ball, every):
    path, last = session
    found = list(poses(str(path), ball, every=every))
    read = load_session(path, ball)
    assert len(found) == 1 + TICKS // every
    scene = Scene(ball, "ball", "cpu")
    player = Player(scene, read)
    for k, vertices in enumerate(found):
        player.play_to(k * every)
        assert np.array_equal(vertices, scene.positions)
    if every == 1:
        assert np.array_equal(found[0], ball.mesh.rest_vertices.astype(np.float32))
        assert np.array_equal(found[-1], last)
        assert np.abs(found[-1] - found[0]).max() > 0.01


def test_mistakes_are_sentences(session, ball, field, tmp_path):
    path, _ = session
    with pytest.raises(ValueError, match="every is 0"):
        next(poses(path, ball, every=0))
    with pytest.raises(SessionError, match="tets"):
        next(poses(path, field))
