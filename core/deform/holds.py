"""Vertices that do not move freely: pins, handles, and the parts that a rescue moves back.

Shapes: V vertices, K handles.
"""

import numpy as np
import warp as wp

from ..base.feed import Feed
from . import checks
from .arrays import VertexArrays
from .constraints import NO_SPRING, spring_coefficients


class Holds:
    """Keeps inverse masses, targets and springs on the device up to date."""

    def __init__(self, pinned, state: VertexArrays):
        self._state = state
        self.pinned, self.rescued = pinned, np.zeros(len(pinned), bool)  # [V]
        self.free_inverse_masses = np.zeros(len(pinned))  # w of vertices that nothing holds  [V]
        self.inverse_masses = self.free_inverse_masses  # w, 0 for kinematic vertices  [V]
        self.handles = np.empty(0, np.int64)  # vertex ids  [K]
        self.springs = None  # stiffness and force limit of each handle [K, 2]; None: exact
        self._targets = None  # of the handles, as last given to move()
        self._positions = Feed(state.vertices)
        # Which handles move [K] bool, their targets on the device, and a Feed of those; None: look.
        self._movable = None

    def set_masses(self, masses):
        """Take masses [kg]; a vertex of mass 0 stays where it is.  [V]"""
        self._stop(np.flatnonzero((masses == 0.0) & (self.free_inverse_masses > 0.0)))
        self.free_inverse_masses = np.divide(1.0, masses, where=masses > 0, out=0.0 * masses)
        self._update()

    def pin(self, mask):
        """Pin these vertices, and free all others.  [V] bool"""
        self._stop(np.flatnonzero(mask & ~self.pinned))
        self.pinned = mask
        self._targets = None  # freed vertices have not received the last ones
        self._update()

    def grab(self, ids, stiffness, force_limit):
        """Make these vertices [K] the handles; see XpbdSolver.grab."""
        self.springs = (
            None if stiffness is None else checks.springs(stiffness, force_limit, len(ids))
        )
        self.handles, self._targets = ids, None
        self._stop(ids[~self.pinned[ids]])
        self._update()

    def move(self, targets):
        """Set the handles' targets.  [K, 3]"""
        targets, count = np.reshape(targets, (-1, 3)), len(self.handles)
        if len(targets) != count:
            raise ValueError(f"{len(targets)} targets for {count} handles")
        targets = checks.vectors(targets, count, "target", "handle")
        if self._targets is not None and np.array_equal(targets, self._targets):
            return
        self._targets = targets.copy()
        if self._movable is None:
            free = ~self.pinned[self.handles]
            values = wp.empty(int(free.sum()), dtype=wp.vec3, device=self._state.targets.device)
            where = self._state.targets[self._ids(self.handles[free])] if len(values) else None
            self._movable = free, where, values, Feed(values)
        free, where, values, feed = self._movable
        if where is not None:
            feed.put(targets[free])
            wp.copy(where, values)

    def set_rescued(self, mask):
        """Make these vertices kinematic, and release those of the rescue before.  [V] bool

        What is released stands still.
        """
        released = np.flatnonzero(self.rescued & ~mask)
        if len(released):
            self._state.velocities[self._ids(released)].zero_()
        self.rescued = mask
        self._update()

    def set_positions(self, vertices):
        """Move all vertices, and anchors and targets with them.  [V, 3]"""
        self._positions.put(vertices)
        for goals in (self._state.anchors, self._state.targets):
            wp.copy(goals, self._state.vertices)
        self._targets = None

    @property
    def held(self):
        """Whether each vertex is kinematic or has a spring.  [V] bool"""
        held = self.inverse_masses == 0.0
        held[self.handles] = True
        return held

    def prepare_springs(self, substep):
        """Update the springs' coefficients for substeps of this length [s]."""
        if self.springs is not None:
            springs = np.full((len(self.pinned), 2), (NO_SPRING, 0.0))
            w = self.inverse_masses[self.handles]
            springs[self.handles] = spring_coefficients(*self.springs.T, w, substep)
            self._state.springs.assign(springs.astype(np.float32))

    def _stop(self, ids):
        """Let the targets of these vertices be where the vertices are."""
        if len(ids):
            ids = self._ids(ids)
            for goals in (self._state.anchors, self._state.targets):
                wp.copy(goals[ids], self._state.vertices[ids])

    def _ids(self, ids):
        return wp.array(ids, dtype=int, device=self._state.vertices.device)

    def _update(self):
        self._movable = None
        kinematic = self.pinned | self.rescued
        if self.springs is None:
            kinematic[self.handles] = True
        self.inverse_masses = np.where(kinematic, 0.0, self.free_inverse_masses)
        self._state.inverse_masses.assign(self.inverse_masses)
