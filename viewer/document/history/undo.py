"""The state of a scene that edits change: kept before each edit, restored by undo and redo."""

from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np

from ....core.deform import XpbdSolver
from .journal import Journal


class Restorable(Protocol):
    """A part of a scene."""

    def state(self) -> dict: ...
    def restore(self, state: dict) -> None: ...


class Undoable(Protocol):
    """A scene whose edits can be undone."""

    body: Restorable
    cuts: Restorable
    viewpoint: Restorable
    handles: Restorable
    timeline: Restorable
    rigging: Restorable
    posing: Restorable
    solver: XpbdSolver
    pinned: np.ndarray  # [V] bool
    pins: np.ndarray  # of a held object  [V] bool
    floor: float
    orbit: Any
    settings: Any
    paused: bool
    revision: int
    first_state: dict
    journal: Journal

    def let_loose(self) -> None: ...


def state_of(scene: Undoable) -> dict:
    """Positions, pins, material and surroundings."""
    solver = scene.solver
    return {
        "body": scene.body.state(),
        "cuts": scene.cuts.state(),
        "viewpoint": scene.viewpoint.state(),
        "handles": scene.handles.state(),
        "timeline": scene.timeline.state(),
        "rigging": scene.rigging.state(),
        "posing": scene.posing.state(),
        "pinned": scene.pinned,
        "vertices": solver.vertices.numpy().copy(),
        "velocities": solver.velocities.numpy().copy(),
        "asleep": solver.settled,
        "rest_lengths": solver.rest_lengths.astype(np.float32),
    }


def is_nothing(scene: Undoable, before: dict) -> bool:
    """Whether an edit has changed nothing since a state; a body that it woke sleeps again."""
    now = state_of(scene) | {"asleep": before["asleep"]}
    if not _same(before, now):
        return False
    if before["asleep"] and not scene.solver.settled:
        scene.solver.fall_asleep()
    return True


def _same(one, other):
    """Whether two states are equal; in doubt they aren't."""
    if one is other:
        return True
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    try:
        return bool(one == other)
    except ValueError:  # dataclasses of arrays
        return False


def restore(scene: Undoable, state: dict) -> None:
    """Return to a state; nothing is held afterwards."""
    scene.let_loose()
    scene.rigging.restore(state["rigging"])
    scene.timeline.restore(state["timeline"])
    scene.cuts.restore(state["cuts"])
    solver = scene.solver
    scene.body.restore(state["body"])
    scene.viewpoint.restore(state["viewpoint"])
    solver.set_pinned(state["pinned"])
    scene.handles.restore(state["handles"])
    solver.set_state(state["vertices"], state["velocities"])
    if not np.array_equal(solver.rest_lengths.astype(np.float32), state["rest_lengths"]):
        solver.set_rest_lengths(state["rest_lengths"])  # edges have yielded since
    scene.posing.restore(state["posing"])
    if state["asleep"]:  # awake, even a body at rest moves by roundings
        solver.fall_asleep()
    scene.revision += 1


def begin_anew(scene: Undoable) -> None:
    """Return to the state of the first frame, without a past."""
    hand = scene.settings.hand
    restore(scene, scene.first_state)
    scene.settings.hand = hand  # a preference
    scene.paused = False
    scene.solver.reset()  # it sleeps
    scene.journal.clear()


@contextmanager
def unless_it_fails(scene: Undoable):
    """In the block, the scene is brought elsewhere; if that raises, it is as it was before."""
    journal = scene.journal
    state, floor, pins, paused = state_of(scene), scene.floor, scene.pins, scene.paused
    view, settings = scene.orbit, dict(vars(scene.settings))
    past = vars(journal) | {"events": list(journal.events), "steps": list(journal.steps)}
    try:
        yield
    except BaseException:
        restore(scene, state)
        scene.floor, scene.pins, scene.orbit = floor, pins, view
        vars(scene.settings).update(settings)
        if scene.paused != paused:
            scene.paused = paused
        vars(journal).update(past)
        raise
