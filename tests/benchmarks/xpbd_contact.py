"""Milliseconds a step with and without contact: two balls, apart and pressed into each other.

python tests/benchmarks/xpbd_contact.py --device cpu
python tests/benchmarks/xpbd_contact.py --device cuda:0

Steps with and without contact take turns, so that what else the machine does changes both.
"""

import argparse
import math
import time

import numpy as np
import warp as wp
from contact_scenes import two_balls

from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver
from deformrf.core.geometry import A15

WARM_UP = 60  # steps, in which the balls come together
APART = 0.7  # m, of the middles at least; whole cells, as parts that training cuts from a grid
PRESSED = 0.06  # m, by which they overlap in the end


def make_solver(rest, tets, contact, device):
    free = np.zeros(len(rest), bool)
    options = XpbdOptions(contact=contact, rescue=False)
    return XpbdSolver(rest, tets, Material(), free, options, device)


def seconds_per_step(rest, tets, halves, way, step_count, device):
    """Times of steps without and with contact [steps, 2], and the number of contacts."""
    lower, upper = halves
    bottom = lower.start + np.flatnonzero(rest[lower, 2] < rest[lower, 2].min() + 0.15)
    top = upper.start + np.flatnonzero(rest[upper, 2] > rest[upper, 2].max() - 0.15)
    handles = np.append(bottom, top)
    solvers = [make_solver(rest, tets, contact, device) for contact in (False, True)]
    times = np.zeros((step_count, 2))
    for solver in solvers:
        solver.grab(handles)
    for step in range(WARM_UP + step_count):
        targets = rest[handles].copy()
        share = min(1.0, step / (0.5 * WARM_UP))
        targets[len(bottom) :, 2] -= share * way + 1e-3 * np.sin(step)  # so that nothing sleeps
        for k in (0, 1) if step % 2 else (1, 0):
            solver = solvers[k]
            solver.move(targets)
            wp.synchronize_device(device)
            start = time.perf_counter()
            solver.step(TIME_STEP)
            wp.synchronize_device(device)
            if step >= WARM_UP:
                times[step - WARM_UP, k] = time.perf_counter() - start
    both = np.ones(2, bool)
    touching = len(solvers[1]._contact.find(TIME_STEP, both, ~both)) > 0
    return times, int(solvers[1]._contact.arrays.counts.numpy()[0]) if touching else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0")
    parser.add_argument("--steps", type=int, default=120, help="how many steps are timed")
    parser.add_argument("--spacings", type=float, nargs="+", default=[0.045, 0.032])
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    print("| tets | balls | contacts | without [ms] | with [ms] | more [ms] |")
    print("|---|---|---|---|---|---|")
    for spacing in arguments.spacings:
        cell = A15.cell_edge * spacing
        rest, tets, halves = two_balls(spacing, cell * math.ceil(APART / cell))
        gap = rest[halves[1], 2].min() - rest[halves[0], 2].max()
        for name, way in (("apart", 0.0), ("touching", gap + PRESSED)):
            inputs = rest, tets, halves, way, arguments.steps, arguments.device
            times, count = seconds_per_step(*inputs)
            without, with_contact = 1e3 * np.median(times, axis=0)
            more = 1e3 * np.median(times[:, 1] - times[:, 0])
            row = f"{without:.3f} | {with_contact:.3f} | {more:.3f}"
            print(f"| {len(tets)} | {name} | {count} | {row} |", flush=True)


if __name__ == "__main__":
    main()
