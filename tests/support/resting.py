"""What rigid_motion.py does to a part, in float64.  Shapes: V vertices of the part."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from deformrf.core.deform.rigid_motion import (
    BRISTLE,
    DRAG,
    LEAST_LOAD,
    ROLLING,
    SHAKING,
    SINKING,
    SMALLEST_ARM,
    SMALLEST_TURN,
    Flight,
)


@dataclass(frozen=True)
class RigidMotion:
    """Of a part, with its momentum and angular momentum."""

    mass: float
    middle: np.ndarray  # c [3]
    velocity: np.ndarray  # u [3]
    spin: np.ndarray  # ω [3]
    inertia: np.ndarray  # I [3, 3]

    @classmethod
    def of(cls, vertices, velocities, masses):
        """Args: [V, 3], [V, 3], [V]"""
        m = masses[:, None]
        middle, velocity = ((m * a).sum(axis=0) / m.sum() for a in (vertices, velocities))
        r = vertices - middle
        inertia = (masses * (r**2).sum(axis=1)).sum() * np.eye(3) - (m * r).T @ r
        least = SMALLEST_TURN * np.trace(inertia) + SMALLEST_ARM**2 * m.sum()
        inertia += least * np.eye(3)
        spin = np.linalg.solve(inertia, (m * np.cross(r, velocities - velocity)).sum(axis=0))
        return cls(masses.sum(), middle, velocity, spin, inertia)

    def at(self, vertices):
        """The velocities of points.  [V, 3]"""
        return self.velocity + np.cross(self.spin, vertices - self.middle)


class Kept(NamedTuple):
    """What is kept of a part from frame to frame."""

    velocity: np.ndarray  # u' [3]
    spin: np.ndarray  # ω' [3]
    bristle: np.ndarray  # z [3]


def rested(motion: RigidMotion, kept: Kept, flight: Flight) -> Kept:
    """Velocity, spin and bristle of a part that may lie on something."""
    up, u, spin = flight.up, motion.velocity, motion.spin
    lift = (u - flight.factor * kept.velocity - flight.gain) @ up
    load = np.clip(lift - LEAST_LOAD * flight.weight, 0.0, flight.weight)
    mean = (u + kept.velocity) / 2.0
    along = (mean @ up) * up
    u = u - clipped(DRAG * along, SINKING * load) - clipped(DRAG * (mean - along), SHAKING * load)
    radius = np.sqrt(np.trace(motion.inertia) / (2.0 * motion.mass))
    most = ROLLING * radius * load * motion.mass
    turn = motion.inertia @ (spin + kept.spin) / 2.0
    bristle = clipped(kept.bristle - BRISTLE * turn, most)
    torque = clipped(bristle - DRAG * turn, most)
    return Kept(u, spin + np.linalg.solve(motion.inertia, torque), bristle)


def clipped(p, most):
    """p, but no longer than that.  [3]"""
    length = np.linalg.norm(p)
    return p if length <= most else most / length * p
