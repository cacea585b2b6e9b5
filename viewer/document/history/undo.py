"""The state of a scene that edits change: kept before each edit, restored by undo and redo."""

from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np

from ....core.deform import XpbdSolver
from .journal import Journal


class Restorable(Protocol):
    """A part of a whole."""

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


def state_of(whole: Undoable) -> dict:
    """Positions, pins, material and surroundings."""
    solver = whole.solver
    return {
        "body": whole.body.state(),
        "cuts": whole.cuts.state(),
        "viewpoint": whole.viewpoint.state(),
        "handles": whole.handles.state(),
        "timeline": whole.timeline.state(),
        "rigging": whole.rigging.state(),
        "posing": whole.posing.state(),
        "pinned": whole.pinned,
        "vertices": solver.vertices.numpy().copy(),
        "velocities": solver.velocities.numpy().copy(),
        "asleep": solver.settled,
        "rest_lengths": solver.rest_lengths.astype(np.float32),
    }


def is_nothing(whole: Undoable, before: dict) -> bool:
    """Whether an edit has changed nothing since a state; a body that it woke sleeps again."""
    now = state_of(whole) | {"asleep": before["asleep"]}
    if not _same(before, now):
        return False
    if before["asleep"] and not whole.solver.settled:
        whole.solver.fall_asleep()
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


def restore(whole: Undoable, state: dict) -> None:
    """Return to a state; nothing is held afterwards."""
    whole.let_loose()
    whole.rigging.restore(state["rigging"])
    whole.timeline.restore(state["timeline"])
    whole.cuts.restore(state["cuts"])
    solver = whole.solver
    whole.body.restore(state["body"])
    whole.viewpoint.restore(state["viewpoint"])
    solver.set_pinned(state["pinned"])
    whole.handles.restore(state["handles"])
    solver.set_state(state["vertices"], state["velocities"])
    if not np.array_equal(solver.rest_lengths.astype(np.float32), state["rest_lengths"]):
        solver.set_rest_lengths(state["rest_lengths"])  # edges have yielded since
    whole.posing.restore(state["posing"])
    if state["asleep"]:  # awake, even a body at rest moves by roundings
        solver.fall_asleep()
    whole.revision += 1


def begin_anew(whole: Undoable) -> None:
    """Return to the state of the first frame, without a past."""
    hand = whole.settings.hand
    restore(whole, whole.first_state)
    whole.settings.hand = hand  # a preference
    whole.paused = False
    whole.solver.reset()  # it sleeps
    whole.journal.clear()


@contextmanager
def unless_it_fails(whole: Undoable):
    """In the block, the scene is brought elsewhere; if that raises, it is as it was before."""
    journal = whole.journal
    state, floor, pins, paused = state_of(whole), whole.floor, whole.pins, whole.paused
    view, settings = whole.orbit, dict(vars(whole.settings))
    past = vars(journal) | {"events": list(journal.events), "steps": list(journal.steps)}
    try:
        yield
    except BaseException:
        restore(whole, state)
        whole.floor, whole.pins, whole.orbit = floor, pins, view
        vars(whole.settings).update(settings)
        if whole.paused != paused:
            whole.paused = paused
        vars(journal).update(past)
        raise
