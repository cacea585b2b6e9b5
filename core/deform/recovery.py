"""Tell the rescue which parts need it, and move those that it selects back to their rest shape.

Besides tangled parts (tangles.py), stuck parts need a rescue.  A part that hangs on a small hinge
can fold over it into a minimum of the energy in which no tet is inverted.  A part is stuck if
nothing holds it, it is not in its rest shape, and its distance to that shape hardly shrinks from
one look to the next.

There are exceptions.  A slow part that contacts keep in another shape is not stuck.  Whether they
keep it is tried out: TRIAL seconds pass in which nothing collides, and are taken back.  If the part
hardly moved by itself, contacts only happen to be there, as in a loop that has turned over.  A fast
part is stuck, in contact or not: a very stiff folded part can turn for ever, because each substep's
projections push it on, against damping and air drag.  Without air drag a part may fly and turn for
ever, and its spin stretches it; so without air drag a fast part is never stuck.

Shapes: V vertices, P parts (connected components).
"""

import math

import numpy as np
import warp as wp

from .holds import Holds
from .rescue import Rescue, distortion, ways_back
from .rest_shape import RestShape
from .xpbd_options import TIME_STEP

PINS_OFF = 0.01  # object sizes by which pins may have moved relative to each other
STUCK_OFF = 0.02  # object sizes by which a part that is stuck is away from its rest shape
STUCK_SHRINKS = 0.005  # of that distance per second at least, if the part returns by itself
STUCK_SPEED = 0.5  # object sizes per second, beyond which a part is fast
LEAST_DAMPING = 1.0  # 1/s; with less, a motion may go on from look to look
SWINGS = 6.0  # 1/damping between looks, in which a swing falls to e⁻³
STUCK_INTERVAL = 2.0  # s between looks, at least
TRIAL = 0.5  # s
FREED = 0.1  # of its distance, by which a part moves in a trial if contacts kept it


class Recovery:
    """The rescue of one body.

    Attributes:
        rescue: What is tried, when, and on which parts.

    Args:
        contact: The body's Contact.
        part_of: [V]
        size: The longest side of the body [m].
        alone: Runs one frame in which nothing collides.
    """

    def __init__(self, state, holds: Holds, rest_shape: RestShape, contact, part_of, size, alone):
        self.rescue, self._ratio = Rescue(), None  # the ratio that coefficients are made for
        self._alone, self._dt = alone, TIME_STEP
        self._state, self._holds, self._rest_shape = state, holds, rest_shape
        self._contact, self._drag, self._interval = contact, 0.0, STUCK_INTERVAL
        self._part_of, self._size = part_of, size
        self._path = None  # where targets start and end, each [V, 3]
        self.touch()

    def touch(self):
        """The user did something: forget what is known."""
        self._pins_fit = None  # None if unknown
        self._load, self._comes_back = None, False
        self.rescue.touch()
        self._look_again()
        self._stop()

    def begin(self, dt, load: str | None, damping, drag, lies) -> bool:
        """Begin a frame of dt [s] in which nothing is grabbed; True to count tangles after it.

        Args:
            load: What holds the body besides its pins, see Rescue.load.
            damping: Of the material [1/s].
            drag: Of the air [1/s].
            lies: Whether the body may lie on a ground.
        """
        self._dt = dt
        self._load = load if self._pins_are_as_at_rest() else "pins"
        self._comes_back = self.returns_to_rest and damping >= LEAST_DAMPING and not lies
        self._drag = drag
        self._interval = max(STUCK_INTERVAL, SWINGS / max(damping, LEAST_DAMPING))
        if self.rescue.running or not self._comes_back:
            self._look_again()
            if self.rescue.running:
                self._since_look = self._interval  # look as soon as the try is over
        self._since_look += dt
        return self.rescue.advance(dt, self._load)

    @property
    def returns_to_rest(self) -> bool:
        """Whether nothing keeps the body from its rest shape."""
        return self._load is None and not self._rest_shape.yields

    def may_sleep(self) -> bool:
        """Whether a body that is still may sleep; looks at its shape if that matters."""
        if not self.rescue.may_sleep:
            return False
        if self.rescue.given_up or not self._comes_back:
            return True
        if self._is_far is None:
            away = self._distances()
            far = away > STUCK_OFF * self._size
            self._is_far = bool(far.any()) and bool((far & ~self._kept_by_contact(away)).any())
        return not self._is_far

    def report(self, counts):
        """Take inverted tets, wrapped edges and lost tets of each part.  [3, P]"""
        tangles = counts[:2].sum(axis=0)
        due = self._since_look >= self._interval - 1e-6 and not self.rescue.running
        if due and not tangles.any():
            self._look()
        self.rescue.report(tangles, counts[2] > 0, self._stuck)

    def follow(self):
        """Do what the rescue wants in this frame; the vertices that it concerns, or None.  [V]"""
        rescue, concerned = self.rescue, None
        if rescue.ratio != self._ratio:
            self._ratio = rescue.ratio
            concerned = np.ones(len(self._part_of), bool)
        if rescue.parts is None:
            return self._stop() if concerned is None else concerned
        if not self._holds.rescued.any():
            pinned = self._holds.pinned
            mesh = self._rest_shape.vertices, self._state.vertices.numpy(), pinned, self._part_of
            self._path = ways_back(*mesh, rescue.parts)
            self._holds.set_rescued(rescue.parts[self._part_of] & ~pinned)
            concerned = self._holds.rescued
        start, goal = self._path
        self._state.targets.assign(start + rescue.progress * (goal - start))
        return concerned

    def _stop(self):
        """Release what is taken back; an empty mask if something was, as no part wakes by it."""
        if not self._holds.rescued.any():
            return None
        nobody = np.zeros(len(self._part_of), bool)
        self._holds.set_rescued(nobody)
        return nobody

    def _pins_are_as_at_rest(self):
        """Whether pins are to each other as at rest."""
        if self._pins_fit is None:
            pinned, rest = self._holds.pinned, self._rest_shape.vertices
            held = self._state.targets.numpy()[pinned]
            self._pins_fit = distortion(rest[pinned], held) < PINS_OFF * self._size
        return self._pins_fit

    def _look_again(self):
        self._since_look, self._away, self._stuck = 0.0, None, 0
        self._is_far = None

    def _distances(self):
        """How far each part is from its rest shape, where and as it lies.  [P]"""
        rest, now = self._rest_shape.vertices, self._state.vertices.numpy()
        every = np.ones(self._part_of.max() + 1, bool)
        _, goal = ways_back(rest, now, self._holds.pinned, self._part_of, every)
        return self._longest(goal - now)

    def _look(self):
        """Compare the parts' distances to their rest shape with those of the look before."""
        away = self._distances()
        before, self._away = self._away, away
        if before is not None:
            least = 1.0 - STUCK_SHRINKS * self._since_look
            stuck = (away > STUCK_OFF * self._size) & (away > least * before)
            if stuck.any():
                fast = self._longest(self._state.velocities.numpy()) > STUCK_SPEED * self._size
                if not self._drag > 0.0:
                    stuck &= ~fast
                if (stuck & ~fast).any():
                    stuck &= fast | ~self._kept_by_contact(away)
            self._stuck = stuck.astype(int)
        self._since_look, self._is_far = 0.0, None

    def _kept_by_contact(self, away):
        """Which parts at these distances from their rest shape would move without contacts.  [P]"""
        if not self._contact.found():
            return np.zeros(len(away), bool)
        if self._contact.first:  # as sessions of that integrator had it
            return np.ones(len(away), bool)
        state = self._state
        moving = state.vertices, state.deltas, state.velocities, state.anchors
        before = [wp.clone(array) for array in moving]
        for _ in range(math.ceil(TRIAL / self._dt)):
            self._alone()
        freed = np.abs(self._distances() - away) > FREED * away
        for array, values in zip(moving, before, strict=True):
            wp.copy(array, values)
        return freed

    def _longest(self, vectors):
        """The largest length of a vector [V, 3] of each part.  [P]"""
        found = np.zeros(self._part_of.max() + 1)
        np.maximum.at(found, self._part_of, np.linalg.norm(vectors, axis=1))
        return found
