"""Random use of the solver, frame after frame: it never loses a number, and it always comes back.

    python tests/benchmarks/random_use.py [--frames 1000000] [--seed N] [--device cpu]

A session is a random body (a ball, a pillar with a thin neck, two parts) that is used for some
seconds: vertices are grabbed, exactly or by springs, dragged near and far, shaken, let go and
pinned; material, gravity, ground, wind, colliders, rest shape and the length of a step change.
After each frame all numbers have to be finite.  At its end everything is taken back, and within
RETURN seconds the body has to be at rest in its own shape.  Prints one line a minute, and the seed
of what failed; exits with 1 if something did.
"""

import argparse
import secrets
import sys
import time

import numpy as np

from deformrf.core.base.device import start_warp
from deformrf.core.deform import (
    TIME_STEP,
    Box,
    Material,
    Sphere,
    XpbdOptions,
    XpbdSolver,
    distortion,
    lowest_pins,
)
from deformrf.core.geometry import a15_grid, extract

SESSION = 20.0  # s of use, on average
RETURN = 30.0  # s in which the body has to be back
BACK = 0.01  # of the size: so near to its rest shape
ACTS_PER_SECOND = 3.0


def bodies():
    """Small meshes: what a substep does is the same in large ones."""
    mesh = a15_grid(0.1)
    x, y, z = (mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5).T
    away = np.hypot(x, y)
    neck = np.where(np.abs(z) < 0.12, 0.1, 0.2)
    yield extract(mesh, x**2 + y**2 + z**2 < 0.3**2)[0]
    yield extract(mesh, (away < neck) & (np.abs(z) < 0.4))[0]
    two = (np.hypot(x - 0.2, y) < 0.13) | (np.hypot(x + 0.2, y) < 0.13)
    yield extract(mesh, two & (np.abs(z) < 0.3))[0]


class Session:
    """One body and what a hand does to it."""

    def __init__(self, mesh, seed, device):
        self.random = np.random.default_rng(seed)
        self.pins = lowest_pins(mesh.rest_vertices, mesh.tets)
        material = Material()
        self.solver = XpbdSolver(
            mesh.rest_vertices, mesh.tets, material, self.pins, XpbdOptions(), device
        )
        self.used = np.unique(mesh.tets)
        self.target, self.frames = None, 0
        self.dt = TIME_STEP

    def run(self) -> str | None:
        """Use the body, take everything back, and wait; what was wrong, or None."""
        for _ in range(round(self.random.exponential(SESSION) / TIME_STEP)):
            if self.random.random() < ACTS_PER_SECOND * TIME_STEP:
                self.random.choice(ACTS)(self)
            if self.target is not None:
                self.target = self.target + self.way
                self.solver.move(self.target)
            if wrong := self.step():
                return wrong
        return self.come_back()

    def step(self):
        self.solver.step(self.dt)
        self.frames += 1
        for array in (self.solver.vertices, self.solver.velocities):
            if not np.isfinite(array.numpy()).all():
                return "a number is not finite"
        return None

    def come_back(self):
        solver, self.dt = self.solver, TIME_STEP
        solver.release()
        solver.set_material(Material())
        solver.set_options(XpbdOptions(air_drag=3.0))
        solver.set_pinned(np.zeros(len(self.pins), bool))
        # To forget what yielded, at the price of the pose.
        pose, velocities = (a.numpy().copy() for a in (solver.vertices, solver.velocities))
        solver.set_rest_shape()
        solver.set_state(pose, velocities)
        for _ in range(round(RETURN / TIME_STEP)):
            if wrong := self.step():
                return wrong
            if solver.settled:
                break
        x, rest = solver.vertices.numpy().astype(np.float64), solver.rest_vertices
        for part in np.unique(solver._part_of[self.used]):
            some = np.intersect1d(np.flatnonzero(solver._part_of == part), self.used)
            away = distortion(rest[some], x[some]) / solver.object_size
            if not away < BACK:
                return f"a part is {100 * away:.1f} % of the size away from its rest shape"
        return None

    # -- what a hand does ----------------------------------------------------------------

    def grab(self):
        count = int(self.random.integers(1, 12))
        ids = self.random.choice(self.used, count, replace=False)
        stiffness = None
        if self.random.random() < 0.5:
            stiffness = 10.0 ** self.random.uniform(1, 7)
        self.solver.grab(ids, stiffness, 10.0 ** self.random.uniform(0, 5))
        self.target = self.solver.vertices.numpy()[ids].astype(np.float64)
        self.way = self.random.normal(size=3) * 10.0 ** self.random.uniform(-4, 0)

    def turn_back(self):
        self.way = -self.random.uniform(0, 2) * getattr(self, "way", np.zeros(3))

    def let_go(self):
        self.solver.release()
        self.target = None

    def pin(self):
        self.solver.set_pinned(self.pins | (self.random.random(len(self.pins)) < 0.02))

    def free(self):
        self.solver.set_pinned(self.pins & (self.random.random() < 0.5))

    def material(self):
        self.solver.set_material(
            Material(
                young_modulus=10.0 ** self.random.uniform(3, 9),
                poisson_ratio=self.random.uniform(0.25, 0.49),
                density=10.0 ** self.random.uniform(1, 4),
                damping=self.random.choice([0.0, 1.0, 5.0]),
                yield_strain=self.random.choice([np.inf, 0.02, 0.2]),
            )
        )

    def surroundings(self):
        def collider():
            center = tuple(self.random.uniform(0, 1, 3))
            size = self.random.uniform(0.05, 0.4)
            return Sphere(center, size) if self.random.random() < 0.5 else Box(center, (size,) * 3)

        self.solver.set_options(
            XpbdOptions(
                substep_count=int(self.random.choice([5, 10, 24])),
                gravity=tuple(self.random.normal(size=3) * self.random.choice([0.0, 10.0])),
                ground=self.random.choice([None, 0.0, 0.3]),
                friction=self.random.uniform(0, 2),
                air_drag=self.random.choice([0.0, 2.0]),
                wind=tuple(self.random.normal(size=3) * 5.0),
                colliders=tuple(collider() for _ in range(self.random.integers(0, 4))),
            )
        )

    def move_colliders(self):
        count = len(self.solver.options.colliders)
        self.solver.move_colliders(self.random.uniform(0, 1, (count, 3)))

    def rest_here(self):
        self.solver.set_rest_shape(self.solver.vertices.numpy())

    def own_shape(self):
        self.solver.set_rest_shape()

    def reset(self):
        self.solver.reset()

    def length_of_a_step(self):
        self.dt = float(self.random.choice([1 / 144, TIME_STEP, 1 / 24, 0.2]))


ACTS = [getattr(Session, name) for name in vars(Session) if not name.startswith("_")]
ACTS = [act for act in ACTS if act not in (Session.run, Session.step, Session.come_back)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    start_warp()
    seed = secrets.randbits(32) if arguments.seed is None else arguments.seed
    meshes, frames, failed, sessions = list(bodies()), 0, 0, 0
    print(f"seed {seed}", flush=True)
    shown = time.monotonic()
    while frames < arguments.frames:
        session = Session(meshes[sessions % len(meshes)], [seed, sessions], arguments.device)
        if wrong := session.run():
            failed += 1
            print(f"session {sessions} of seed {seed}: {wrong}", flush=True)
        frames, sessions = frames + session.frames, sessions + 1
        if time.monotonic() - shown > 60.0:
            shown = time.monotonic()
            print(f"{frames:,} frames, {sessions} sessions, {failed} failed", flush=True)
    print(f"{frames:,} frames, {sessions} sessions, {failed} failed")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
