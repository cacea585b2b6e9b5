"""Physics between two poses of the timeline: what they hold is moved, and the rest follows.

Shapes: V vertices, K that are moved.
"""

import numpy as np

from ....core.deform import XpbdSolver
from . import keys as k


class Drive:
    """What is moved from one pose key to the next.

    Attributes:
        way: The two keys.
        pins: Those that are moved, and so aren't the solver's.  [V] bool
    """

    def __init__(self, solver: XpbdSolver, way: tuple[k.PoseKey, k.PoseKey]):
        """Take hold of what these keys hold."""
        first, second = self.way = way
        moves = (first.vertices != second.vertices).any(axis=1)
        driven = (first.held | second.held) & (moves | ~first.pinned)
        self.pins = driven & first.pinned
        self._solver, self._ids = solver, np.flatnonzero(driven)  # [K]
        set_pins(solver, first.pinned & ~driven)
        solver.grab(self._ids)

    def move(self, tick: int) -> None:
        """Send what is moved to where it is at a tick."""
        self._solver.move(k.vertices_at(self.way, tick)[self._ids].astype(float))

    def differs(self, first: k.PoseKey, last: k.PoseKey) -> bool:
        """Whether two keys have what is moved at other places."""
        return not np.array_equal(first.vertices[self._ids], last.vertices[self._ids])

    def pins_after(self, head: int):
        """What is pinned without it: it stays where it has come to by that tick.  [V] bool"""
        second = self.way[1]
        return second.pinned if head >= second.tick else self._solver.pinned | self.pins


def set_pins(solver: XpbdSolver, pinned) -> None:
    """Pin these vertices [V] bool alone, if others are pinned."""
    if not np.array_equal(pinned, solver.pinned):
        solver.set_pinned(pinned)
