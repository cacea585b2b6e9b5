"""Milliseconds per solver step (one frame, 20 substeps) of a dragged ball, by mesh size.

python tests/benchmarks/xpbd_speed.py --device cpu
python tests/benchmarks/xpbd_speed.py --device cuda:0 --spacings 0.0255 0.0205 0.0092 0.0043

Floors, measured in the same run:

    bandwidth  every constraint and vertex read and written once a substep, by what a copy takes
    latency    the same frame with every vertex pinned: colors without constraints, barriers,
               and what a step costs on the host
"""

import argparse
import time
from dataclasses import replace

import numpy as np
import warp as wp

from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver, lowest_pins
from deformrf.core.geometry import a15_grid, extract

WARM_UP = 5
EDGE_BYTES, TET_BYTES, VERTEX_BYTES = 28, 60, 56  # ids, spans, lengths, a; d twice, v, w, before
COPY_BYTES = 2**28
DIAMETER = 0.6


def ball(spacing):
    """A ball of diameter 0.6 in the middle of the unit cube."""
    mesh = a15_grid(spacing / DIAMETER)  # not cut from the whole cube, which is 8 times as much
    away = np.linalg.norm(mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5, axis=1)
    mesh, _ = extract(mesh, away < 0.5)
    return replace(mesh, rest_vertices=0.5 + DIAMETER * (mesh.rest_vertices - 0.5))


def make_solver(mesh, poisson_ratio, device, substep_count):
    """A ball on its foot, and the handles at its top, grabbed."""
    solver = XpbdSolver(
        mesh.rest_vertices,
        mesh.tets,
        Material(poisson_ratio=poisson_ratio),
        lowest_pins(mesh.rest_vertices, mesh.tets),
        XpbdOptions(substep_count=substep_count),
        device,
    )
    top = np.flatnonzero(mesh.rest_vertices[:, 2] > 0.75)
    solver.grab(top)
    return solver, top


def milliseconds_per_step(solver, top, step_count):
    """The median over steps in which the handles move, and its tenth and ninetieth percentile."""
    times = []
    for step in range(WARM_UP + step_count):
        solver.move(solver.rest_vertices[top] + [0.1 * np.sin(step * TIME_STEP), 0.0, 0.0])
        wp.synchronize_device(solver.device)
        start = time.perf_counter()
        solver.step(TIME_STEP)
        wp.synchronize_device(solver.device)
        times.append(time.perf_counter() - start)
    assert np.isfinite(solver.vertices.numpy()).all()
    return 1e3 * np.quantile(times[WARM_UP:], [0.5, 0.1, 0.9])


def seconds_per_byte(device):
    """What reading and writing takes at best."""
    first, second = (wp.zeros(COPY_BYTES // 4, dtype=float, device=device) for _ in range(2))
    times = []
    for _ in range(5):
        wp.synchronize_device(device)
        start = time.perf_counter()
        wp.copy(second, first)
        wp.synchronize_device(device)
        times.append(time.perf_counter() - start)
    return min(times) / (2 * COPY_BYTES)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0")
    parser.add_argument("--steps", type=int, default=40, help="how many steps are timed")
    parser.add_argument("--substeps", type=int, default=20)
    parser.add_argument(
        "--spacings", type=float, nargs="+", default=[0.03, 0.0255, 0.0205], help="of the A15 grid"
    )
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    per_byte = seconds_per_byte(arguments.device)

    name = wp.get_device(arguments.device).name
    print(f"{name}, {1e-9 / per_byte:.0f} GB/s, {arguments.steps} steps of {arguments.substeps}")
    print("| tets | vertices | colors | r | edges only | with volumes | bandwidth | latency |")
    print("|---|---|---|---|---|---|---|---|")
    for spacing in arguments.spacings:
        mesh, cells = ball(spacing), []
        for ratio in (0.25, Material().poisson_ratio):
            solver, top = make_solver(mesh, ratio, arguments.device, arguments.substeps)
            median, low, high = milliseconds_per_step(solver, top, arguments.steps)
            cells.append(f"{median:.2f} ({low:.2f}–{high:.2f})")
        edges, volumes = solver.edges, solver.volumes
        colors = f"{len(edges.offsets) - 1} + {len(volumes.offsets) - 1}"
        count = (
            EDGE_BYTES * len(edges.vertices)
            + TET_BYTES * len(volumes.vertices)
            + VERTEX_BYTES * mesh.vertex_count
        )
        ratio = solver.stiffness_ratio()
        solver.set_pinned(np.ones(mesh.vertex_count, bool))
        idle = milliseconds_per_step(solver, top, arguments.steps)[0]
        bandwidth = 1e3 * arguments.substeps * count * per_byte
        print(
            f"| {mesh.tet_count} | {mesh.vertex_count} | {colors} | {ratio:.1f}"
            f" | {cells[0]} | {cells[1]} | {bandwidth:.2f} | {idle:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
