"""Error against run time on a clamped beam: by substeps, compliance and lattice.

    python tests/benchmarks/xpbd_error.py --device cpu
    python tests/benchmarks/xpbd_error.py --device cuda:0 --spacing 0.015625 --out out/error_cuda

Writes OUT.csv (errors over the size, and over the motion), OUT_static.png and OUT_dynamic.png.
The beam hangs under gravity instead of being pushed; otherwise scenes, references and errors
are those of wings/lab/dynamics/measure.py.  The stored files of docs/dynamics have other schemes
too (iterations, plain float32): they are those of 295a2e3.
"""

import argparse
import csv
from pathlib import Path

from hanging_beams import LATTICES, beam_case

from deformrf.core.base.device import start_warp
from deformrf.wings.lab.dynamics.measure import SCENES, measure
from deformrf.wings.lab.report.plots import new_figure, png

COUNTS = (1, 2, 5, 10, 20, 50, 100, 200)
COMPLIANCES = (0.0, 1e-8, 1e-6, 1e-4, None)


def plot(rows, path):
    """Errors of one scene over counts and over milliseconds, a column for each lattice.

    Args:
        rows: (lattice, compliance in words, tets, DynamicsRow)
    """
    from matplotlib.lines import Line2D

    lattices = list(dict.fromkeys((lattice, tets) for lattice, _, tets, _ in rows))
    labels = list(dict.fromkeys(label for _, label, _, _ in rows))
    figure = new_figure(4.6 * len(lattices), 7.6)
    axes = figure.subplots(2, len(lattices), sharey=True, squeeze=False)
    for axis_pair, (lattice, tets) in zip(axes.T, lattices, strict=True):
        axis_pair[0].set_title(f"{lattice}, {tets} tets, {rows[0][-1].scene}")
        along = (lambda row: row.count), (lambda row: row.frame.median)
        for axis, place in zip(axis_pair, along, strict=True):
            for index, label in enumerate(labels):
                line = [row for *which, _, row in rows if which == [lattice, label]]
                axis.loglog(
                    [place(row) for row in line],
                    [row.of_size for row in line],
                    "-o",
                    color=f"C{index}",
                    markersize=3.5,
                    linewidth=1.1,
                )
            axis.grid(True, which="major", linewidth=0.4)
        axis_pair[0].set_xlabel("substeps a frame")
        axis_pair[1].set_xlabel("ms a frame")
    for axis in axes[:, 0]:
        axis.set_ylabel("RMS error, % of the size")
    colors = [Line2D([], [], color=f"C{i}", label=label) for i, label in enumerate(labels)]
    figure.legend(
        handles=colors,
        loc="outside lower center",
        ncols=4,
        fontsize=8,
        frameon=False,
        title="compliance of every edge [m/N], or the default material",
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
                label = "material" if alpha is None else f"{alpha:g}"
                for count in arguments.counts:
                    row = measure(case, count, arguments.device)
                    rows.append((lattice, label, len(case.body.tets), row))
                    print(
                        f"{scene:8} {lattice:5} {label:>9} {count:4d}"
                        f" {row.of_size:.2e} % rms {row.largest:.2e} % max"
                        f" {row.frame.median:7.2f} ms {row.frames:5d} frames",
                        flush=True,
                    )
        chosen = [row for row in rows if row[-1].scene == scene]
        plot(chosen, arguments.out.with_name(f"{arguments.out.name}_{scene}.png"))
    lines = [
        {
            "scene": row.scene,
            "lattice": lattice,
            "tets": tets,
            "compliance": label,
            "scheme": "substeps",
            "count": row.count,
            "device": arguments.device,
            "rms": row.of_size / 100.0,
            "largest": row.largest / 100.0,
            "of_motion": row.of_motion and row.of_motion / 100.0,
            "milliseconds": row.frame.median,
            "frames": row.frames,
        }
        for lattice, label, tets, row in rows
    ]
    with open(arguments.out.with_suffix(".csv"), "w", newline="") as file:
        writer = csv.DictWriter(file, lines[0])
        writer.writeheader()
        writer.writerows(lines)


if __name__ == "__main__":
    main()
