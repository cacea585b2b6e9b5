"""Options of time steps and of the object's surroundings.  SI units; z is up."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from . import checks
from .colliders import MOST_COLLIDERS, Collider

TIME_STEP = 1.0 / 60.0  # s; XpbdOptions.substep_count is the number of substeps in it
LONGEST_STEPS = 6  # of TIME_STEP; in a longer step the substeps are longer, not more
# What a substep takes, and each edge of the mesh in it [s]: of the H100's time and that of two CPU
# cores, the longer.  Measured from 3,000 to 100,000 tets; parts in contact take twice as long.
SUBSTEP_SECONDS, EDGE_SECONDS = 8e-6, 2.2e-9
SOLVER_SHARE = 0.25  # of TIME_STEP: the most that substeps take where their number is automatic
COUNT_STEP = 8  # between such numbers, so that a small change of the material keeps the number
NO_GROUND = -3e38  # below every vertex; finite: fast arithmetic may ignore infinities


class Integrator(NamedTuple):
    """How a substep moves on in time (definition/solver.py)."""

    theta: float  # at which share of it constraints are projected
    floor: float  # the least a/w̄
    sparse_floor: float  # the same of volumes where only few tets hold theirs (locking.py)


_EULER, _SECOND_ORDER = Integrator(1.0, 0.05, 0.05), Integrator(0.54, 1.25, 0.6)
_DAMPED = Integrator(0.8, 0.4, 0.1)
STIFF = 0.66  # a lower r = α/(w h²) of the median edge
# For materials that substeps hold, for stiffer ones, and for what needs Euler's damping: the
# rescue, and what may come to rest on a ground or a collider (XpbdSolver.integrator).  With smaller
# floors or θ some motion grows (docs/design/002-dynamics.md).  Sessions name theirs; those that
# name none have the first.
INTEGRATORS = {
    "euler": (_EULER, _EULER, _EULER),
    "extrapolated": (_SECOND_ORDER, _DAMPED, _EULER),
}
FIRST_INTEGRATOR, DEFAULT_INTEGRATOR = INTEGRATORS


class Timing(NamedTuple):
    """The numbers that all vertices share, in the order of the kernels' array `timing`."""

    substep: float  # h [s]
    decay: float  # exp(-δ h), δ the damping
    speed_limit: float  # v_max [m/s]
    gravity_x: float  # g [m/s²]
    gravity_y: float
    gravity_z: float
    ground: float = NO_GROUND  # its height z [m]
    friction: float = 0.0  # Coulomb's coefficient on the ground, colliders and in contacts
    air: float = 1.0  # exp(-c h), c the air's drag
    gust_x: float = 0.0  # (1 - air) times the wind's velocity [m/s]
    gust_y: float = 0.0
    gust_z: float = 0.0
    theta: float = 1.0  # of the Integrator

    @property
    def reach(self) -> float:
        """θh [s], for which constraints are projected."""
        return self.theta * self.substep


@dataclass(frozen=True)
class XpbdOptions:
    """Options of time steps and of the object's surroundings.

    Raises:
        ValueError: A value is out of range.
    """

    substep_count: int = 24  # per 1/60 s; the highest stiffness grows with its square
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)  # g [m/s²]
    ground: float | None = None  # height of a ground that nothing falls through [m]
    friction: float = 0.5  # Coulomb's coefficient on the ground, on colliders and in contacts
    colliders: tuple[Collider, ...] = ()  # XpbdSolver.move_colliders moves them
    air_drag: float = 0.0  # c, the rate at which velocities relative to the wind decay [1/s]
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)  # the air's velocity [m/s]
    contact: bool = True  # whether the mesh collides with itself (contact/)
    # v_max in object sizes per second.  Without a limit, the release after an extreme drag
    # throws vertices through each other.
    speed_limit: float = 20.0
    sleep_motion: float = 1e-5  # object sizes; a frame is still if no vertex moves farther in it
    sleep_frames: int = 30  # the solver sleeps after so many still frames
    rescue: bool = True  # whether parts that stay tangled get their rest shape back (rescue.py)
    integrator: str = DEFAULT_INTEGRATOR  # one of INTEGRATORS

    def __post_init__(self):
        counts = ("substep_count", "substeps a frame", 1), ("sleep_frames", "frames to sleep", 0)
        for name, words, least in counts:
            value = getattr(self, name)
            if not (value >= least and int(value) == value):
                raise ValueError(f"{value} {words}; give a whole number from {least} on")
        for name in ("gravity", "wind"):
            value = getattr(self, name)
            if np.shape(value) != (3,) or not np.isfinite(value).all():
                raise ValueError(f"{name} is {value}; give three finite numbers")
        if self.ground is not None and not math.isfinite(self.ground):
            raise ValueError(f"the ground's height is {self.ground}; give a number, or None")
        checks.number("speed limit", self.speed_limit)
        checks.number("sleep motion", self.sleep_motion)
        checks.number("friction", self.friction)
        checks.number("air drag", self.air_drag)
        if self.integrator not in INTEGRATORS:
            names = " or ".join(map(repr, INTEGRATORS))
            raise ValueError(f"there is no integrator {self.integrator!r}; give {names}")
        if len(self.colliders) > MOST_COLLIDERS:
            raise ValueError(f"{len(self.colliders)} colliders; {MOST_COLLIDERS} are the most")

    @property
    def load(self) -> str | None:
        """What may hold a body in another shape than its rest shape; see Rescue.load."""
        if any(self.gravity):
            return "weight"
        if self.air_drag and any(self.wind):
            return "wind"
        return "colliders" if self.colliders else None

    def substeps(self, dt: float) -> int:
        """n for a step of dt [s].  It keeps h, and so the pose, independent of the frame rate."""
        count = round(dt / TIME_STEP * self.substep_count)
        return min(max(count, 1), LONGEST_STEPS * self.substep_count)

    def timing(self, dt: float, damping: float, object_size: float, theta: float = 1.0) -> Timing:
        """The kernels' numbers for steps of dt [s]; damping [1/s], object_size [m], θ."""
        h = dt / self.substeps(dt)
        air = math.exp(-self.air_drag * h)
        return Timing(
            h,
            math.exp(-damping * h),
            self.speed_limit * object_size,
            *self.gravity,
            NO_GROUND if self.ground is None else self.ground,
            self.friction,
            air,
            *((1.0 - air) * np.asarray(self.wind)),
            theta,
        )


def automatic_counts(edge_count: int) -> range:
    """The numbers of substeps that a solver chooses from: from the default to SOLVER_SHARE."""
    most = int(SOLVER_SHARE * TIME_STEP / (SUBSTEP_SECONDS + EDGE_SECONDS * edge_count))
    least = XpbdOptions.substep_count
    return range(least, max(most, least) + 1, COUNT_STEP)
