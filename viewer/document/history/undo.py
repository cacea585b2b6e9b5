"""The state of a scene that edits change: kept before each edit, restored by undo and redo."""

from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np

from ....core.deform import XpbdSolver
from .journal import Edited, Journal


class Pausable(Protocol):
    """A clock."""

    paused: bool


class Undoable(Protocol):
    """A scene whose edits can be undone."""

    parts: dict[str, Edited]
    solver: XpbdSolver
    pinned: np.ndarray  # [V] bool
    pins: np.ndarray  # of a held object  [V] bool
    floor: float
    orbit: Any
    settings: Any
    clock: Pausable
    revision: int
    journal: Journal

    def let_loose(self) -> None: ...


class States:
    """The states of one scene: what it is now, and the way back to what it was."""

    def __init__(self, whole: Undoable):
        self._whole = whole
        self._first = self.now()

    def now(self) -> dict:
        """Positions, pins, material and surroundings."""
        whole, solver = self._whole, self._whole.solver
        return {name: one.state() for name, one in whole.parts.items()} | {
            "pinned": whole.pinned,
            "vertices": solver.vertices.numpy().copy(),
            "velocities": solver.velocities.numpy().copy(),
            "asleep": solver.settled,
            "rest_lengths": solver.rest_lengths.astype(np.float32),
        }

    def is_still(self, before: dict) -> bool:
        """Whether an edit has changed nothing since a state; a body that it woke sleeps again."""
        if not _same(before, self.now() | {"asleep": before["asleep"]}):
            return False
        if before["asleep"] and not self._whole.solver.settled:
            self._whole.solver.fall_asleep()
        return True

    def restore(self, state: dict) -> None:
        """Return to a state; nothing is held afterwards."""
        whole, parts = self._whole, self._whole.parts
        whole.let_loose()
        for name in ("rigging", "timeline", "cuts", "body", "viewpoint"):
            parts[name].restore(state[name])
        whole.solver.set_pinned(state["pinned"])
        parts["handles"].restore(state["handles"])
        solver = whole.solver
        solver.set_state(state["vertices"], state["velocities"])
        if not np.array_equal(solver.rest_lengths.astype(np.float32), state["rest_lengths"]):
            solver.set_rest_lengths(state["rest_lengths"])  # edges have yielded since
        parts["posing"].restore(state["posing"])
        if state["asleep"]:  # awake, even a body at rest moves by roundings
            solver.fall_asleep()
        whole.revision += 1

    def begin_anew(self) -> None:
        """Return to the state of the first frame, without a past."""
        whole = self._whole
        hand = whole.settings.hand
        self.restore(self._first)
        whole.settings.hand = hand  # a preference
        whole.clock.paused = False
        whole.solver.reset()  # it sleeps
        whole.journal.clear()

    @contextmanager
    def unless_it_fails(self):
        """In the block, the scene is brought elsewhere; if that raises, it is as before."""
        whole, journal = self._whole, self._whole.journal
        state, floor, pins, paused = self.now(), whole.floor, whole.pins, whole.clock.paused
        view, settings = whole.orbit, dict(vars(whole.settings))
        past = vars(journal) | {"events": list(journal.events), "steps": list(journal.steps)}
        try:
            yield
        except BaseException:
            self.restore(state)
            whole.floor, whole.pins, whole.orbit = floor, pins, view
            vars(whole.settings).update(settings)
            if whole.clock.paused != paused:
                whole.clock.paused = paused
            vars(journal).update(past)
            raise


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
