"""Spheres and boxes that no vertex may enter; they may move.

A vertex inside a collider is pushed out by the shortest way.  Friction slows its motion relative to
the collider, as on the ground.  Units: m.
"""

from dataclasses import dataclass

import numpy as np

from . import checks

SPHERE, BOX = 0.0, 1.0
MOST_COLLIDERS = 8
COLLIDER_SIZE = 10  # kind, center at the frame's start and at its end, half of the sides


@dataclass(frozen=True)
class Sphere:
    """All points within a radius of a center."""

    center: tuple[float, float, float]
    radius: float

    def __post_init__(self):
        checks.vectors(np.reshape(self.center, (1, -1)), 1, "center", "sphere")
        checks.number("sphere's radius", self.radius, positive=True)

    @property
    def row(self) -> list[float]:
        """Its numbers on the device.  [COLLIDER_SIZE]"""
        return [SPHERE, *self.center, *self.center, self.radius, self.radius, self.radius]


@dataclass(frozen=True)
class Box:
    """A box along the axes."""

    center: tuple[float, float, float]
    sides: tuple[float, float, float]

    def __post_init__(self):
        checks.vectors(np.reshape(self.center, (1, -1)), 1, "center", "box")
        checks.vectors(np.reshape(self.sides, (1, -1)), 1, "sides", "box")
        if min(self.sides) <= 0.0:
            raise ValueError(f"the sides of a box are {self.sides}; give positive numbers")

    @property
    def row(self) -> list[float]:
        """Its numbers on the device.  [COLLIDER_SIZE]"""
        return [BOX, *self.center, *self.center, *(0.5 * side for side in self.sides)]


Collider = Sphere | Box


class ColliderRows:
    """The colliders of a solver, and their rows on the device.

    Args:
        array: [MOST_COLLIDERS, COLLIDER_SIZE]
    """

    def __init__(self, array):
        self._array = array
        self._rows = array.numpy().copy()  # as they will be after the next frame
        self._count, self._stale = 0, False

    def put(self, colliders):
        """Take these colliders, which stand where they are."""
        self._count, self._stale = len(colliders), True
        self._rows[: self._count] = np.reshape([c.row for c in colliders], (-1, COLLIDER_SIZE))

    def move(self, centers):
        """Move the centers there within the next frame.  [C, 3]"""
        centers = checks.vectors(centers, self._count, "center", "collider")
        self._rows[: self._count, 4:7] = centers
        self._stale = True

    def begin(self) -> int:
        """A frame begins; the number of colliders."""
        if self._stale:
            self._array.assign(self._rows)
        return self._count

    def end(self):
        """A frame is over: they have arrived."""
        if not self._stale:
            return
        self._stale = bool((self._rows[:, 1:4] != self._rows[:, 4:7]).any())
        self._rows[:, 1:4] = self._rows[:, 4:7]
