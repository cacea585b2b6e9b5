"""Milliseconds per solver step (one frame, 20 substeps) of a dragged ball, by mesh size.

python tests/benchmarks/xpbd_speed.py --device cpu
python tests/benchmarks/xpbd_speed.py --device cuda:0 --spacings 0.0255 0.0205 0.0092
"""

import argparse
import time

import numpy as np
import warp as wp

from deformrf.core.deform.handles import lowest_pins
from deformrf.core.deform.material import Material
from deformrf.core.deform.xpbd import XpbdSolver
from deformrf.core.geometry.lattice import a15_grid
from deformrf.core.geometry.mesh import extract

DT = 1.0 / 60.0
WARM_UP = 5


def ball(spacing):
    """A ball of diameter 0.6 in the middle of the grid."""
    mesh = a15_grid(spacing)
    away = np.linalg.norm(mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5, axis=1)
    return extract(mesh, away < 0.3)[0]


def milliseconds_per_step(mesh, poisson_ratio, device, step_count):
    """The median over steps in which a handle moves, and the solver."""
    pins = lowest_pins(mesh.rest_vertices, mesh.tets)
    material = Material(poisson_ratio=poisson_ratio)
    solver = XpbdSolver(mesh.rest_vertices, mesh.tets, material, pins, device=device)
    top = np.flatnonzero(mesh.rest_vertices[:, 2] > 0.75)
    solver.grab(top)
    times = []
    for step in range(WARM_UP + step_count):
        solver.move(mesh.rest_vertices[top] + [0.1 * np.sin(step * DT), 0.0, 0.0])
        wp.synchronize_device(device)
        start = time.perf_counter()
        solver.step(DT)
        wp.synchronize_device(device)
        times.append(time.perf_counter() - start)
    assert np.isfinite(solver.vertices.numpy()).all()
    return 1e3 * float(np.median(times[WARM_UP:])), solver


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0")
    parser.add_argument("--steps", type=int, default=40, help="how many steps are timed")
    parser.add_argument(
        "--spacings", type=float, nargs="+", default=[0.03, 0.0255, 0.0205], help="of the A15 grid"
    )
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR

    print(f"{wp.get_device(arguments.device).name}, {arguments.steps} steps each, median")
    print(f"{'tets':>8} {'vertices':>9} {'r':>6} {'edges only':>12} {'with volumes':>13}")
    for spacing in arguments.spacings:
        mesh = ball(spacing)
        edges_only, _ = milliseconds_per_step(mesh, 0.25, arguments.device, arguments.steps)
        default = Material().poisson_ratio
        both, solver = milliseconds_per_step(mesh, default, arguments.device, arguments.steps)
        print(
            f"{mesh.tet_count:8d} {mesh.vertex_count:9d} {solver.stiffness_ratio():6.2f}"
            f" {edges_only:9.2f} ms {both:10.2f} ms",
            flush=True,
        )


if __name__ == "__main__":
    main()
