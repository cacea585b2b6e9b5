"""Error against run time on a clamped beam: substeps and iterations, by compliance and lattice.

    python tests/benchmarks/xpbd_error.py --device cpu
    python tests/benchmarks/xpbd_error.py --device cuda:0 --spacing 0.015625 --out out/error_cuda

Writes OUT.csv (errors over the size, and over the motion), OUT_static.png and OUT_dynamic.png.
The beam hangs under gravity instead of being pushed; otherwise scenes, references and errors
are those of wings/lab/dynamics/measure.py.  Five schemes:

    substeps        the program's solver, n substeps of one iteration
    uncorrected     the same without what makes up for the softening of a sweep
    iterations      one substep of n iterations with stored multipliers (iteration_solver.py)
    unfloored       the same without the floor under the compliance, which is in units of h²
    plain float32   n substeps whose positions are plain float32 (plain_solver.py, NumPy)
"""

import argparse
import csv
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from beams import beam
from iteration_solver import IterationSolver
from plain_solver import PlainSolver

from deformrf.core.base.device import start_warp
from deformrf.core.deform import COMPLIANCE_FLOOR
from deformrf.core.geometry import A15, BCC, KUHN
from deformrf.wings.lab.dynamics.measure import SCENES, Body, LoadCase, measure
from deformrf.wings.lab.report.plots import new_figure, png

LATTICES = {"a15": A15, "bcc": BCC, "kuhn": KUHN}
# And how they are drawn.
SCHEMES = {
    "substeps": "-o",
    "uncorrected": "-.v",
    "iterations": "--s",
    "unfloored": ":^",
    "plain float32": "-.x",
}
COUNTS = (1, 2, 5, 10, 20, 50, 100, 200)
COMPLIANCES = (0.0, 1e-8, 1e-6, 1e-4, None)
GRAVITY = (0.0, 0.0, -9.81)


def beam_case(lattice, spacing, compliance, scene) -> LoadCase:
    """A beam under gravity; compliance is None for the default material."""
    body = beam(LATTICES[lattice], spacing)
    rounded = body.mesh.rest_vertices.astype(np.float32).astype(np.float64)
    return LoadCase(Body(rounded, body.mesh.tets, body.clamped), scene, GRAVITY, compliance)


def solver_of(case: LoadCase, scheme, count, device):
    """A solver of a scheme, ready to step."""
    rest, tets, held = case.body
    body = rest, tets, case.material, held
    if scheme in ("substeps", "uncorrected"):
        solver = case.solver(count, device)
        for part in (solver.edges, solver.volumes) if scheme == "uncorrected" else ():
            plain = partial(part.regularization, softening=(0.0, 0.0))
            object.__setattr__(part, "regularization", plain)  # the class is frozen
        return solver
    if scheme == "plain float32":
        solver = PlainSolver(*body, case.options(count))
    else:
        floor = COMPLIANCE_FLOOR if scheme == "iterations" else 0.0
        solver = IterationSolver(*body, case.options(1), count, floor, device)
    if case.compliance is not None:
        solver.set_compliances(case.compliance, None)
    return solver


def measured(case: LoadCase, scheme, count, device):
    """A row of the table: see DynamicsRow.  Times of plain float32 are those of NumPy."""
    row = measure(case, count, device, solver=solver_of(case, scheme, count, device))
    return replace(row, scheme=scheme)


def plot(rows, path):
    """Errors of one scene over counts and over milliseconds, a column for each lattice.

    Args:
        rows: (lattice, tets, DynamicsRow)
    """
    from matplotlib.lines import Line2D

    lattices = list(dict.fromkeys((lattice, tets) for lattice, tets, _ in rows))
    labels = list(dict.fromkeys(row.compliance for _, _, row in rows))
    figure = new_figure(4.6 * len(lattices), 7.6)
    axes = figure.subplots(2, len(lattices), sharey=True, squeeze=False)
    for axis_pair, (lattice, tets) in zip(axes.T, lattices, strict=True):
        axis_pair[0].set_title(f"{lattice}, {tets} tets, {rows[0][2].scene}")
        along = (lambda row: row.count), (lambda row: row.frame.median)
        for axis, place in zip(axis_pair, along, strict=True):
            for index, label in enumerate(labels):
                for scheme, style in SCHEMES.items():
                    line = [
                        row
                        for name, _, row in rows
                        if (name, row.compliance, row.scheme) == (lattice, label, scheme)
                    ]
                    axis.loglog(
                        [place(row) for row in line],
                        [row.of_size for row in line],
                        style,
                        color=f"C{index}",
                        markersize=3.5,
                        linewidth=1.1,
                    )
            axis.grid(True, which="major", linewidth=0.4)
        axis_pair[0].set_xlabel("substeps or iterations a frame")
        axis_pair[1].set_xlabel("ms a frame")
    for axis in axes[:, 0]:
        axis.set_ylabel("RMS error, % of the size")
    colors = [Line2D([], [], color=f"C{i}", label=label) for i, label in enumerate(labels)]
    styles = [
        Line2D([], [], color="gray", linestyle=style[:-1], marker=style[-1], label=scheme)
        for scheme, style in SCHEMES.items()
    ]
    figure.legend(
        handles=colors + styles,
        loc="outside lower center",
        ncols=4,
        fontsize=8,
        frameon=False,
        title="compliance of every edge [m/N], or the default material; scheme",
        title_fontsize=8,
    )
    path.write_bytes(png(figure))


def compliance(word):
    return None if word == "material" else float(word)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0")
    parser.add_argument("--lattices", nargs="+", default=["a15", "bcc"], choices=LATTICES)
    parser.add_argument("--spacing", type=float, default=1 / 32, help="dx [m] of a 1 m beam")
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES)
    native = [scheme for scheme in SCHEMES if scheme != "plain float32"]  # that is NumPy's
    parser.add_argument("--schemes", nargs="+", default=native, choices=SCHEMES)
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS)
    parser.add_argument(
        "--compliances",
        type=compliance,
        nargs="+",
        default=COMPLIANCES,
        help="of every edge [m/N], or the word material",
    )
    parser.add_argument("--out", type=Path, default=Path("out/xpbd_error"))
    arguments = parser.parse_args()
    start_warp()

    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    for scene in arguments.scenes:
        for lattice in arguments.lattices:
            for alpha in arguments.compliances:
                case = beam_case(lattice, arguments.spacing, alpha, scene)
                for scheme in arguments.schemes:
                    for count in arguments.counts:
                        row = measured(case, scheme, count, arguments.device)
                        rows.append((lattice, len(case.body.tets), row))
                        print(
                            f"{scene:8} {lattice:5} {row.compliance:>9} {count:4d} {scheme:11}"
                            f" {row.of_size:.2e} % rms {row.largest:.2e} % max"
                            f" {row.frame.median:7.2f} ms {row.frames:5d} frames",
                            flush=True,
                        )
        chosen = [row for row in rows if row[2].scene == scene]
        plot(chosen, arguments.out.with_name(f"{arguments.out.name}_{scene}.png"))
    lines = [
        {
            "scene": row.scene,
            "lattice": lattice,
            "tets": tets,
            "compliance": row.compliance,
            "scheme": row.scheme,
            "count": row.count,
            "device": arguments.device,
            "rms": row.of_size / 100.0,
            "largest": row.largest / 100.0,
            "of_motion": row.of_motion and row.of_motion / 100.0,
            "milliseconds": row.frame.median,
            "frames": row.frames,
        }
        for lattice, tets, row in rows
    ]
    with open(arguments.out.with_suffix(".csv"), "w", newline="") as file:
        writer = csv.DictWriter(file, lines[0])
        writer.writeheader()
        writer.writerows(lines)


if __name__ == "__main__":
    main()
