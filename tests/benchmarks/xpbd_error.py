"""Error against run time: substeps and iterations, by compliance, lattice and device.

    python tests/benchmarks/xpbd_error.py --device cpu
    python tests/benchmarks/xpbd_error.py --device cuda:0 --spacing 0.015625 --out out/error_cuda

Writes OUT.csv, and OUT_static.png and OUT_dynamic.png.  What the scenes, references and
errors are: core/lab/dynamics/error.py.
"""

import argparse
import csv
from pathlib import Path

from deformrf.core.device import start_warp
from deformrf.core.lab.dynamics import error
from deformrf.core.lab.report.parts import record


def compliance(word):
    return None if word == "material" else float(word)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0")
    parser.add_argument("--lattices", nargs="+", default=["a15", "bcc"], choices=error.LATTICES)
    parser.add_argument("--spacing", type=float, default=1 / 32, help="dx [m] of a 1 m beam")
    parser.add_argument("--scenes", nargs="+", default=error.SCENES, choices=error.SCENES)
    native = [scheme for scheme in error.SCHEMES if scheme != "plain float32"]  # that is NumPy's
    parser.add_argument("--schemes", nargs="+", default=native, choices=error.SCHEMES)
    parser.add_argument("--counts", type=int, nargs="+", default=error.COUNTS)
    parser.add_argument(
        "--compliances",
        type=compliance,
        nargs="+",
        default=error.COMPLIANCES,
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
                case = error.make_case(lattice, arguments.spacing, alpha, scene)
                for scheme in arguments.schemes:
                    for count in arguments.counts:
                        row = error.measure(case, scheme, count, arguments.device)
                        rows.append(row)
                        print(
                            f"{scene:8} {lattice:5} {row.compliance!s:>9} {count:4d} {scheme:11}"
                            f" {row.rms:.2e} rms {row.largest:.2e} max {row.frame.median:7.2f} ms"
                            f" {row.frames:5d} frames",
                            flush=True,
                        )
        chosen = [row for row in rows if row.scene == scene]
        error.plot(chosen, arguments.out.with_name(f"{arguments.out.name}_{scene}.png"))
    with open(arguments.out.with_suffix(".csv"), "w", newline="") as file:
        writer = csv.DictWriter(file, record(rows[0]))
        writer.writeheader()
        writer.writerows(record(row) for row in rows)


if __name__ == "__main__":
    main()
