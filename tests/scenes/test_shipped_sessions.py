"""Sessions that ship fit the bundled model, and play to their end."""

import numpy as np
import pytest

from deformrf.core.base.paths import ASSETS, DEFAULT_MODEL, ROOT
from deformrf.core.field import load
from deformrf.viewer.document import Player, Scene, load_session

SESSIONS = sorted(p for folder in (ASSETS, ROOT / "docs") for p in folder.rglob("*.jsonl"))


def test_readme_s_session_is_there():
    assert ASSETS / "demo.jsonl" in SESSIONS


@pytest.mark.parametrize("path", SESSIONS, ids=lambda path: path.name)
def test_a_shipped_session_plays_on_the_bundled_model(path):
    """If this fails for a new model: tests/benchmarks/demo_session.py makes the session anew."""
    field = load(DEFAULT_MODEL)
    session = load_session(path, field)
    scene = Scene(field, DEFAULT_MODEL.stem, "cpu")
    player, rest, farthest = Player(scene, session), scene.positions.copy(), 0.0
    for tick in range(0, session.ticks + 1, 20):
        player.play_to(tick)
        assert np.isfinite(scene.positions).all()
        moved = np.linalg.norm(scene.positions - rest, axis=1).max() / scene.size
        farthest = max(farthest, float(moved))
    player.play_to(session.ticks)
    assert np.isfinite(scene.positions).all()
    assert 0.05 < farthest < 1.0  # it shows a bend, and nothing that flies off
