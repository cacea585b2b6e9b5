"""Physics between two poses of the timeline: what they hold is moved, and the rest follows.

Shapes: V vertices, K that are moved.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ....core.deform import XpbdSolver
from . import keys as k


@dataclass
class Drive:
    """What is moved from one pose key to the next."""

    first: k.PoseKey
    second: k.PoseKey
    ids: np.ndarray  # [K]
    pins: np.ndarray  # those of them that are pinned otherwise  [V] bool


class Gripped(Protocol):
    """What a hand holds."""

    hand: np.ndarray  # ids


class Driven(Protocol):
    """What physics moves between two poses."""

    solver: XpbdSolver
    grip: Gripped


class Driver:
    """What of one object is moved; nothing, until `move`."""

    def __init__(self, driven: Driven):
        self._driven = driven
        self._drive: Drive | None = None

    @property
    def taken_pins(self):
        """Pins that are moved, and so aren't the solver's.  [V] bool"""
        none = np.zeros(len(self._driven.solver.pinned), bool)
        return none if self._drive is None else self._drive.pins

    def move(self, keys, tick: int) -> None:
        """Send what the keys around a tick hold to where it is at the next tick."""
        first, second, _ = k.around(keys, tick)
        drive = self._drive
        if drive is None or drive.first is not first or drive.second is not second:
            drive = self._drive = self._begin(first, second)
        places = k.vertices_at((first, second), tick + 1)[drive.ids]
        self._driven.solver.move(places.astype(float))

    def _begin(self, first, second):
        moves = (first.vertices != second.vertices).any(axis=1)
        driven = (first.held | second.held) & (moves | ~first.pinned)
        ids = np.flatnonzero(driven)
        self.set_pins(first.pinned & ~driven)
        self._driven.solver.grab(ids)
        return Drive(first, second, ids, driven & first.pinned)

    def breaks(self, keys) -> bool:
        """Whether what is moved is not where the first key has it, after the last one."""
        first, last, held = keys[0], keys[-1], self._drive
        return not np.array_equal(first.vertices[held.ids], last.vertices[held.ids])

    def end(self, head: int) -> None:
        """Give back what is moved; what is pinned stays where it has come to."""
        solver, drive = self._driven.solver, self._drive
        if drive is None:
            return
        arrived = head >= drive.second.tick
        pins = drive.second.pinned if arrived else solver.pinned | drive.pins
        self._drive = None
        if not len(self._driven.grip.hand):
            solver.release()
        self.set_pins(pins)

    def set_pins(self, pinned) -> None:
        if not np.array_equal(pinned, self._driven.solver.pinned):
            self._driven.solver.set_pinned(pinned)
