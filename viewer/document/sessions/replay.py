"""The poses of a session, for programs that have no window."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ....core.base.device import start_warp
from ....core.field import TetField
from ..scene.scene import Scene
from .player import Player
from .session import load_session


def poses(
    path: str | Path, field: TetField, every: int = 1, device: str = "cpu"
) -> Iterator[np.ndarray]:
    """Play a session of a model, and yield its vertices at tick 0, `every`, 2 `every` ...

    What the user deleted is not in it: the vertices are those of the whole model.

    Args:
        field: The model as it was when the session began.
        every: Ticks of 1/60 s from one pose to the next.
        device: Warp's name; a session played on another device than it was recorded on ends
            in another pose, though in a similar one.

    Yields:
        [V, 3] float32, model space.

    Raises:
        ValueError: `every` is less than 1.
        SessionError: The file is no session, is damaged, or is one of another mesh.
        OSError: It can't be read.
    """
    if every < 1:
        raise ValueError(f"every is {every}; give the ticks from pose to pose, at least 1")
    start_warp()
    session = load_session(Path(path), field)
    scene = Scene(field, Path(path).stem, device)
    player = Player(scene, session)
    for tick in range(0, session.ticks + 1, every):
        player.play_to(tick)
        yield scene.positions.copy()
