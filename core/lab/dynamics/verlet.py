"""How an elastic body moves: velocity Verlet in float64 on the energy of energy.py.

    v ← exp(−δ h/2) v,   v ← v + h/2 a(x),   x ← x + h v,   v ← v + h/2 a(x),   v ← exp(−δ h/2) v
    a = g − ∂energy/∂x / m

Second order in h and symplectic for δ = 0.  Held vertices go straight to their targets.
The same run with h and 2h says how exact it is (self-difference): its error at h is a third
of that difference.  Compliance 0 has no such reference, and needs none: what is infinitely
stiff and clamped doesn't move.

Shapes: V vertices.
"""

import math
from dataclasses import dataclass

import numpy as np

from .energy import Energy

COURANT = 0.2  # of the longest stable step, 2/ω_max


@dataclass(frozen=True)
class Motion:
    """Attributes:
    vertices: At the end.  [V, 3]
    velocities: At the end.  [V, 3]
    path: At the end of each of `samples` equal parts of the duration.  [samples, V, 3]
    step: h [s].
    self_difference: RMS difference to the run with 2h, over the path [m].
    energy_drift: Of elastic, kinetic and potential energy, over its largest kinetic part.
    """

    vertices: np.ndarray
    velocities: np.ndarray
    path: np.ndarray
    step: float
    self_difference: float
    energy_drift: float


def motion(
    energy: Energy,
    start,
    held,
    duration,
    gravity=(0.0, 0.0, 0.0),
    damping=0.0,
    targets=None,
    step=None,
    samples=1,
) -> Motion:
    """From rest at `start`, for a duration [s].

    Args:
        start: [V, 3] m
        held: Which vertices don't move freely.  [V] bool
        damping: δ of v' = −δ v [1/s].
        targets: Where held vertices shall be at the end; None for where they are.  [V, 3]
        step: h [s]; None takes a fifth of the longest stable one.
        samples: How many positions on the way are kept.
    """
    if step is None:
        step = COURANT * 2.0 / highest_frequency(energy, start, held)
    count = 2 * samples * math.ceil(duration / step / (2 * samples))
    end = np.asarray(start if targets is None else targets, np.float64)
    run = Run(
        energy, np.asarray(start, np.float64), end, ~np.asarray(held), np.array(gravity), damping
    )
    coarse, _, _ = run.go(duration, count // 2, samples)
    path, velocities, drift = run.go(duration, count, samples)
    difference = float(np.sqrt(((path - coarse) ** 2).sum(axis=2).mean()))
    return Motion(path[-1], velocities, path, duration / count, difference, drift)


def highest_frequency(energy: Energy, x, held, rounds=60):
    """ω_max [rad/s] of small motions about x, by power iteration (a little too low)."""
    scale = np.repeat(np.where(held, 0.0, 1.0 / np.sqrt(energy.masses)), 3)
    hessian = energy.hessian(np.asarray(x, np.float64))
    mode = np.random.default_rng(0).normal(size=len(scale))
    for _ in range(rounds):
        mode = scale * (hessian @ (scale * mode))
        squared = np.linalg.norm(mode)
        mode /= squared
    return math.sqrt(squared)


@dataclass(frozen=True)
class Run:
    """What runs of different steps share; see motion()."""

    energy: Energy
    start: np.ndarray
    end: np.ndarray
    free: np.ndarray
    gravity: np.ndarray
    damping: float

    def go(self, duration, count, samples):
        """Vertices on the way, velocities at the end, and the drift of energy."""
        h = duration / count
        free, mobility = self.free[:, None], (self.free / self.energy.masses)[:, None]
        push = np.where(free, self.gravity, 0.0)
        path = (self.end - self.start) / duration
        x, v = self.start.copy(), np.where(free, 0.0, path)
        decay = np.where(free, math.exp(-0.5 * self.damping * h), 1.0)
        kick = 0.5 * h * (push - mobility * self.energy.gradient(x))
        total, kinetic = [self._total(x, v)], 0.0
        every, path = max(1, count // 10), []
        for step in range(count):
            v = decay * v + kick
            x = x + h * v
            kick = 0.5 * h * (push - mobility * self.energy.gradient(x))
            v = decay * (v + kick)
            if step % every == every - 1:
                total.append(self._total(x, v))
                kinetic = max(kinetic, self._kinetic(v))
            if (step + 1) % (count // samples) == 0:
                path.append(x)
        drift = float(np.ptp(total) / kinetic) if kinetic > 0 else 0.0
        return np.array(path), v, drift

    def _kinetic(self, v):
        return 0.5 * (self.energy.masses[:, None] * v**2).sum()

    def _total(self, x, v):
        fallen = (self.energy.masses[:, None] * self.gravity * x).sum()
        return self.energy.value(x) + self._kinetic(v) - fallen
