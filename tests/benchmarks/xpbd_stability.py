"""Every stress case on every lattice and material: which bodies come back, and how soon.

python tests/benchmarks/xpbd_stability.py --workers 2             # about 3,900 runs, 0.3 s each
python tests/benchmarks/xpbd_stability.py --quick
python tests/benchmarks/xpbd_stability.py --device cuda:0 --large 1000000

Writes out/xpbd_stability.csv (a line for each run) and .md (a table of the worst over
seeds).  Run k of a case has the seed k.
"""

import argparse
import csv
import multiprocessing
import os
import time
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import warp as wp
from rich.progress import track

from deformrf.core.deform import Material, XpbdSolver
from deformrf.core.geometry import A15, BCC, KUHN, TetMesh, a15_grid, extract
from deformrf.core.geometry.lattice import grid
from deformrf.wings.lab.stability.measure import NamedMaterial, run_case
from deformrf.wings.lab.stability.stress import CASES

GRIDS = {"A15": (A15, 46 / 64), "BCC": (BCC, 12 / 8), "Kuhn": (KUHN, 6)}  # tets/dx³
TET_COUNT = 1300
MODULI = [10.0**k for k in range(3, 10)]
RATIOS = [0.0, 0.25, 0.35, 0.45, 0.499]
RIGID = 0.0  # stands for compliance 0
ONE_TET = TetMesh(
    rest_vertices=np.array([[-0.3, -0.3, 0.2], [0.3, -0.3, 0.2], [0.0, 0.4, 0.2], [0, 0, 0.7]]),
    addresses=np.zeros((4, 3), np.int32),
    tets=np.array([[0, 1, 2, 3]], np.int32),
)


def dome(lattice, tet_count):
    """A ball of diameter 0.6 without its lowest sixth, of about so many tets.

    A whole ball stands on so few vertices that E = 1e3 Pa rights it in minutes only.
    """
    cell, density = GRIDS[lattice]
    volume = 4.0 / 3.0 * np.pi * 0.3**3 - np.pi * 0.1**2 * (0.3 - 0.1 / 3.0)
    mesh = grid(cell, (volume * density / tet_count) ** (1.0 / 3.0))
    away = mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5
    return extract(mesh, (np.linalg.norm(away, axis=1) < 0.3) & (away[:, 2] > -0.2))[0]


@dataclass(frozen=True)
class Run:
    """One line of the table."""

    lattice: str
    tet_count: int
    young_modulus: float
    poisson_ratio: float
    case: str
    seed: int
    device: str

    @property
    def material(self):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # ratios below 1/4 are part of the table
            return Material(
                young_modulus=self.young_modulus or 5e5, poisson_ratio=self.poisson_ratio
            )


def body(run):
    if run.lattice == "one tet":
        return ONE_TET
    if run.lattice == "A15 cube":  # a dome would be cut from ten times as many tets
        return a15_grid((46 / 64 / run.tet_count) ** (1.0 / 3.0))
    return dome(run.lattice, run.tet_count)


def execute(run: Run):
    """The run's line as a dictionary."""
    wp.config.log_level = wp.LOG_ERROR
    case = next(case for case in CASES if case.name == run.case)
    solid = NamedMaterial(run.lattice, run.material, rigid=run.young_modulus == RIGID)
    line = asdict(run_case(body(run), solid, case, run.device, run.seed)) | asdict(run)
    return {key: value for key, value in line.items() if key != "material"}


def matrix(arguments):
    """All runs that were asked for."""
    moduli = [1e3, 1e6, 1e9] if arguments.quick else MODULI
    ratios = [0.25, 0.499] if arguments.quick else RATIOS
    materials = [(modulus, ratio) for modulus in moduli for ratio in ratios] + [(RIGID, 0.35)]
    default = (Material().young_modulus, Material().poisson_ratio)
    runs = []
    for lattice in [*arguments.lattices, "one tet"]:
        for modulus, ratio in [*materials, default]:
            for case in CASES:
                if lattice == "one tet" and not case.suits(ONE_TET.tets):
                    continue
                if case.uneven and (modulus, ratio) != default:
                    continue
                tets = 1 if lattice == "one tet" else TET_COUNT
                for seed in range(seed_count(case, arguments.quick)):
                    run = Run(lattice, tets, modulus, ratio, case.name, seed, arguments.device)
                    runs.append(run)
    return runs


def seed_count(case, quick):
    if not (case.start == "random" or case.drive or case.broken_tets or case.uneven):
        return 1
    if case.name == "random":
        return 2 if quick else 10
    return 1 if quick else 3


def held(run):
    """What the material is like that is held: r, E and ν, as text."""
    mesh = body(run)
    free = np.zeros(mesh.vertex_count, bool)
    solver = XpbdSolver(mesh.rest_vertices, mesh.tets, run.material, free)
    if run.young_modulus == RIGID:
        return "0 | – | –"
    r, ratio = solver.stiffness_ratio(), run.material.held_poisson_ratio
    return f"{r:.2g} | {solver.held_young_modulus():.2g} | {ratio:g}"


def cell(lines):
    """The worst of a case's seeds, as text."""
    if not lines:
        return "–"
    failed = [line for line in lines if not line["passed"]]
    if not all(line["finite"] for line in lines):
        return f"**NaN** ({sum(not line['finite'] for line in lines)} of {len(lines)})"
    if failed:
        worst = max(failed, key=lambda line: line["error"])
        error, inverted = worst["error"], worst["inverted"]
        return f"**{len(failed)} of {len(lines)}**: {error:.1f} %, {inverted} inv."
    slowest = [line["recovery_seconds"] for line in lines]
    if None in slowest:
        return f"finite, {max(line['error'] for line in lines):.0f} %"
    rescued = sum(line["rescues"] > 0 for line in lines)
    return f"{max(slowest):.1f} s" + (f" ({rescued} r)" if rescued else "")


def table(runs, lines):
    """Markdown: a row for each lattice and material."""
    names = [case.name for case in CASES]
    rows = [
        f"Device {runs[0].device}.  Cells: seconds to recover, the slowest of the seeds (n r: in n "
        "of them the solver had to rescue itself); or how many failed, and the worst.",
        "",
        "| lattice | E | ν | r | held E | held ν | " + " | ".join(names) + " |",
        "|" + "---|" * (6 + len(names)),
    ]
    groups = {}
    for run, line in zip(runs, lines, strict=True):
        key = (run.lattice, run.young_modulus, run.poisson_ratio)
        groups.setdefault(key, (run, {}))[1].setdefault(run.case, []).append(line)
    for (lattice, modulus, ratio), (run, cases) in groups.items():
        material = "α = 0 | –" if modulus == RIGID else f"{modulus:.0e} | {ratio:g}"
        cells = " | ".join(cell(cases.get(name)) for name in names)
        rows.append(f"| {lattice} | {material} | {held(run)} | {cells} |")
    return "\n".join(rows)


def large_runs(arguments):
    """A large body: what remains after a case is reported, finite suffices."""
    for name in ("drag 100x", "random"):
        run = Run("A15 cube", arguments.large, 5e5, 0.35, name, 0, arguments.device)
        line = execute(run)
        kept = ("finite", "recovery_seconds", "error", "inverted", "rescues")
        print(f"{arguments.large} tets, {name}:", {key: line[key] for key in kept}, flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer materials and seeds")
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0")
    parser.add_argument("--workers", type=int, default=1, help="processes side by side")
    parser.add_argument("--lattices", nargs="+", default=list(GRIDS), choices=list(GRIDS))
    parser.add_argument("--large", type=int, metavar="TETS", help="a body of so many tets instead")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder of the tables")
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    if arguments.large:
        large_runs(arguments)
        return
    runs = matrix(arguments)
    begin = time.perf_counter()
    os.environ["OMP_NUM_THREADS"] = "1"  # of each worker
    with multiprocessing.get_context("spawn").Pool(arguments.workers) as pool:
        results = pool.imap(execute, runs, chunksize=4)
        lines = list(track(results, "Stress cases", total=len(runs)))
    arguments.out.mkdir(parents=True, exist_ok=True)
    with open(arguments.out / "xpbd_stability.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, lines[0])
        writer.writeheader()
        writer.writerows(lines)
    text = table(runs, lines)
    (arguments.out / "xpbd_stability.md").write_text(text + "\n", encoding="utf-8")
    print(text)
    failed = [line for line in lines if not line["passed"]]
    for line in failed:
        print("failed:", line)
    seconds = time.perf_counter() - begin
    print(f"{len(lines) - len(failed)} of {len(lines)} passed, {seconds:.0f} s")


if __name__ == "__main__":
    main()
