"""What holds vertices of the object at the same time: the mouse, and bones.

The solver has one list of handles; here each of the two has its own share of it.  Without bones,
the solver gets what the mouse holds, unchanged.  K vertices that are held.
"""

from typing import Protocol

import numpy as np

from ....core.deform import XpbdSolver

NOBODY = np.empty(0, np.int64)


class Solved(Protocol):
    """What a solver moves."""

    solver: XpbdSolver  # another one after tets were deleted; nothing is held then


class Hold:
    """The handles of one body's solver."""

    def __init__(self, body: Solved):
        self._body = body
        self.hand = self.bones = NOBODY  # ids  [K]
        self._hand_targets = self._bone_targets = None  # [K, 3]; None: not sent anywhere yet
        self._springs = ()  # of the hand

    def grab(self, ids, *springs) -> None:
        """The mouse takes vertices, exactly or by springs (stiffness and force limit of each).

        While bones hold something, it takes them exactly, and not those that bones hold.
        """
        self.hand, self._springs, self._hand_targets = np.asarray(ids), springs, None
        self._give()

    def move(self, targets) -> None:
        """Send what the mouse holds to these places.  [K, 3]"""
        self._hand_targets = np.asarray(targets, float)
        self._send()

    def release(self) -> None:
        self.grab(NOBODY)

    def hold_bones(self, ids, targets) -> None:
        """Bones hold these vertices [K], and send them to these places.  [K, 3]"""
        changed = ids is not self.bones and not np.array_equal(ids, self.bones)
        self.bones, self._bone_targets = np.asarray(ids), np.asarray(targets, float)
        if changed:
            self._give()
        else:
            self._send()

    def release_bones(self) -> None:
        if len(self.bones):
            self.bones, self._bone_targets = NOBODY, None
            self._give()

    @property
    def _free(self):
        """Which of the mouse's vertices bones don't hold.  [K] bool"""
        return ~np.isin(self.hand, self.bones)

    def _give(self):
        if len(self.bones):
            self._body.solver.grab(np.concatenate([self.hand[self._free], self.bones]))
        else:
            self._body.solver.grab(self.hand, *self._springs)
        if len(self.bones) or self._hand_targets is not None:
            self._send()

    def _send(self):
        solver, targets = self._body.solver, self._hand_targets
        if len(self.bones) and len(self.hand):
            places = solver.vertices.numpy()[self.hand] if targets is None else targets
            targets = np.concatenate([places[self._free], self._bone_targets])
        elif len(self.bones):
            targets = self._bone_targets
        solver.move(targets)
