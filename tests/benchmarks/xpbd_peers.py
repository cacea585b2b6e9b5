"""Our solver beside NVIDIA Newton's on one mesh: milliseconds per frame and error.

python tests/benchmarks/xpbd_peers.py --device cpu
python tests/benchmarks/xpbd_peers.py --device cuda:0 --spacings 0.0205 0.0092

A ball stands on its pinned foot under gravity; its top is dragged 0.1 m aside while frames
are timed, then held until the ball rests.  Masses, pins, handles, dt, substeps, gravity,
damping and speed limit are the same for all.  The energies:

    springs   Ours (wings/lab/dynamics/energy.py), with volumes in few tets
    each      The same with K in each tet.  Newton's solvers take this one, as XPBD is unstable with
              few stiff tets: springs of k_e, and tets of k_lambda = K, k_mu ≈ 0 (SolverXPBD skips
              a tet whose k_mu is 0)
    stable    Newton's tets in SolverVBD (xpbd_statics.py)
    split     Newton's tets in SolverXPBD; at small strain they resist no shear

Error: how far the last pose is from the static one (float64) of the solver's own energy, and
of `springs`, by the way from rest to there (root mean squares over free vertices).  Motion:
the farthest that a vertex went in the last frame; a solver that holds still has converged.
A frame of Newton's is one captured graph, on the CPU too.
"""

import argparse
import time
from dataclasses import replace

import numpy as np
import warp as wp
import xpbd_statics
from newton_peer import NewtonPeer, newton, newton_model
from xpbd_speed import WARM_UP, ball

from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver, lowest_pins
from deformrf.wings.lab.dynamics.energy import material_energy
from deformrf.wings.lab.dynamics.references import equilibrium

GRAVITY = (0.0, 0.0, -9.81)
MATERIAL = Material(damping=30.0)  # so that the ball soon rests; where doesn't depend on it
DRAG = 0.1  # m
SOLVERS = {  # name: energy, Newton's class, iterations a substep
    "ours": ("springs", None, 1),
    "newton-xpbd": ("each", "SolverXPBD", 2),
    "newton-xpbd-1": ("each", "SolverXPBD", 1),
    "newton-vbd-1": ("each", "SolverVBD", 1),
    "newton-vbd": ("each", "SolverVBD", 10),
    "newton-vbd-tets": ("stable", "SolverVBD", 10),
    "newton-xpbd-tets": ("split", "SolverXPBD", 2),
}


class Scene:
    """The mesh, what it is made of, and what is held where."""

    gravity = GRAVITY
    damping = MATERIAL.damping

    def __init__(self, spacing, device):
        mesh = ball(spacing)
        self.device, self.is_cuda = device, wp.get_device(device).is_cuda
        self.rest = mesh.rest_vertices.astype(np.float32).astype(np.float64)
        self.tets = mesh.tets
        self.pins = lowest_pins(self.rest, mesh.tets)
        self.top = np.flatnonzero(self.rest[:, 2] > 0.75)
        self.held = self.pins.copy()
        self.held[self.top] = True
        self.energy = material_energy(self.rest, mesh.tets, MATERIAL)
        mu, added = MATERIAL.shear_modulus, MATERIAL.bulk_modulus
        of_each = added / (6.0 * self.energy.volumes)
        self.energies = {
            "springs": self.energy,
            "each": replace(self.energy, volume_stiffnesses=of_each),
        }
        self.moduli = dict.fromkeys(("stable", "split"), (mu, mu + added))  # K = λ − μ
        self.speed_limit = XpbdOptions().speed_limit * float(np.ptp(self.rest, axis=0).max())
        self.models, self.poses = {}, {}

    def dragged(self, fraction):
        """Where held vertices are; free ones at rest.  [V, 3]"""
        places = self.rest.copy()
        places[self.top, 0] += DRAG * fraction
        return places

    def equilibrium(self, energy, start):
        """The static pose of an energy, near one whose held vertices are in place.  [V, 3]"""
        if energy in self.energies:
            return equilibrium(self.energies[energy], start, self.held, GRAVITY)[0]
        weights = self.energy.masses[:, None] * GRAVITY
        density = xpbd_statics.DENSITIES[energy]
        solids = xpbd_statics.Solids(self.rest, self.tets, density, *self.moduli[energy])
        return solids.rest_pose(start, self.held, weights, "cuda" if self.is_cuda else "cpu")

    def error(self, energy, pose):
        """In percent, as a word where there is no number."""
        if not np.isfinite(pose).all():
            return "NaN"
        if energy not in self.poses:
            start = np.where(self.held[:, None], self.dragged(1.0), pose)
            try:
                self.poses[energy] = self.equilibrium(energy, start)
            except RuntimeError as error:
                print(error)
                self.poses[energy] = None
        static, free = self.poses[energy], ~self.held
        if static is None:
            return "unknown"
        way = np.linalg.norm((static - self.rest)[free])
        return f"{100 * np.linalg.norm((pose - static)[free]) / way:.2f} %"

    def newton(self, substeps, energy, solver, iterations):
        if energy not in self.models:
            self.models[energy] = newton_model(self, energy)
        return NewtonPeer(self, self.models[energy], substeps, TIME_STEP, solver, iterations)


class Ours:
    def __init__(self, scene, substeps):
        options = XpbdOptions(substep_count=substeps, gravity=GRAVITY)
        arguments = scene.rest, scene.tets, MATERIAL, scene.pins, options, scene.device
        self.scene, self.solver = scene, XpbdSolver(*arguments)
        self.solver.grab(scene.top)
        self.vertices = self.solver.vertices

    def move(self, places):
        self.solver.move(places[self.scene.top])

    def step(self):
        self.solver.step(TIME_STEP)


def measure(scene, solver, frames, settling):
    """Milliseconds of each timed frame, the last pose, and the motion in the last frame."""
    times, poses = [], []
    for frame in range(WARM_UP + frames + settling):
        solver.move(scene.dragged(min(1.0, max(0.0, (frame + 1 - WARM_UP) / frames))))
        wp.synchronize_device(scene.device)
        start = time.perf_counter()
        solver.step()
        wp.synchronize_device(scene.device)
        times.append(1e3 * (time.perf_counter() - start))
        poses = [*poses[-1:], solver.vertices.numpy().astype(np.float64)]
    motion = np.linalg.norm(poses[1] - poses[0], axis=1).max()
    return times[WARM_UP : WARM_UP + frames], poses[1], motion


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0")
    parser.add_argument("--frames", type=int, default=20, help="how many are timed")
    parser.add_argument("--settling", type=int, default=60, help="frames in which it comes to rest")
    parser.add_argument("--spacings", type=float, nargs="+", default=[0.0205], help="of the grid")
    parser.add_argument("--substeps", type=int, nargs="+", default=[20], help="even numbers")
    parser.add_argument("--solvers", nargs="+", choices=SOLVERS, default=list(SOLVERS))
    arguments = parser.parse_args()
    if any(count % 2 for count in arguments.substeps):
        parser.error("an odd number of substeps; Newton's two states are swapped in each")
    wp.config.log_level = wp.LOG_ERROR
    if newton is None:
        print("Newton is missing, so only our solver runs: pip install newton")
    version = newton.__version__ if newton else "missing"
    print(f"{wp.get_device(arguments.device).name}; Warp {wp.__version__}; Newton {version}")
    print("| solver | tets | substeps x iterations | ms a frame (10–90 %) | energy |", end="")
    print(" error | to springs | motion |\n|---|---|---|---|---|---|---|---|")
    for spacing in arguments.spacings:
        scene = Scene(spacing, arguments.device)
        for name in arguments.solvers:
            how = energy, peer, iterations = SOLVERS[name]
            if peer and newton is None:
                continue
            for substeps in arguments.substeps:
                solver = scene.newton(substeps, *how) if peer else Ours(scene, substeps)
                times, pose, motion = measure(scene, solver, arguments.frames, arguments.settling)
                low, middle, high = np.percentile(times, [10, 50, 90])
                print(
                    f"| {name} | {len(scene.tets)} | {substeps} x {iterations}"
                    f" | {middle:.2f} ({low:.2f}–{high:.2f}) | {energy}"
                    f" | {scene.error(energy, pose)} | {scene.error('springs', pose)}"
                    f" | {1e3 * motion:.3f} mm |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
