"""What several reports say together, as Markdown: the tables of docs/report and of the README.

python tests/benchmarks/report_tables.py docs/report --models helmet chair foxrig \
    --devices h100 cpu

Reports lie in folders called MODEL-DEVICE.
"""

import argparse
import json
from pathlib import Path

from deformrf.core.deform import XpbdOptions

NAMES = {"h100": "one H100", "cpu": "two CPU cores"}
SUBSTEPS, FEWER_SUBSTEPS = XpbdOptions().substep_count, 20
CASES = {
    "collapsed to a plane, a line, a point": ("plane", "line", "point"),
    "mirrored": ("mirrored",),
    "random positions, at steps of 1/60, 1/5 and 1 s": ("random", "dt 1/5 s", "dt 1 s"),
    "one vertex dragged 100 sizes away, all shaken at 30 Hz": ("drag 100x", "shake 30 Hz"),
    "inverted and flat tets at rest": ("broken tets",),
    "masses that differ by 10⁶ (finite is enough)": ("mass ratio 1e6",),
}
OMISSIONS = {  # how its name begins in a report, and what it is called here
    "samples in empty": "samples in empty sub-tets",
    "samples behind": "samples behind what is opaque",
    "the path for overlap": "the path for overlap",
    "volume constraints at a Poisson's ratio of 1/4": "volumes at a Poisson's ratio of 1/4",
    "the solver while": "the solver while nothing moves",
    "table entries": "table entries that nothing reaches",
    "torch, at the start": "torch, at the start",
    "torch, in memory": "torch, in memory",
}


def table(report, section, name=None):
    return report["sections"][section]["tables"][name or section]


def default_row(report):
    return table(report, "rendering")[0]


def image_error(report):
    row = default_row(report)
    largest = max(row["largest"], row["largest_anywhere"])
    return f"{row['psnr']:.1f}, {row['worst_psnr']:.1f}, {largest:.1f}/255"


def motion_error(report, count):
    rows = {
        row["scene"]: row
        for row in table(report, "dynamics")
        if (row["scheme"], row["compliance"], row["count"]) == ("substeps", "material", count)
    }
    return f"{rows['static']['of_motion']:.1f}, {rows['dynamic']['of_motion']:.1f}"


def frame(report):
    rows = [row for row in table(report, "dynamics") if row["default"]]
    return f"{rows[0]['frame_ms']:.3g}"


def passed(rows):
    return f"{sum(row['passed'] for row in rows)} of {len(rows)}"


def omission(report, beginning):
    rows = [row for row in table(report, "left_out") if row["name"].startswith(beginning)]
    if not rows or rows[0]["saving"] is None:
        return "–"
    row = rows[0]
    return f"{row['saving']:.3g} {row['unit']} of {row['with_it']:.3g}"


def print_together(reports):
    """A column for each model and device."""
    rows = {
        "a view by default, ms": lambda r: f"{default_row(r)['frame_ms']:.3g}",
        "its error: dB, worst view, largest of any pixel": image_error,
        "against test views, dB": lambda r: f"{default_row(r)['photo_psnr']:.2f}",
        "the float64 reference's own error, dB": lambda r: (
            f"{r['sections']['rendering']['values']['reference_psnr']:.1f}"
        ),
        f"a frame of {SUBSTEPS} substeps, ms": frame,
        "its error under load, in motion, % of the motion": lambda r: motion_error(r, SUBSTEPS),
        f"the same with {FEWER_SUBSTEPS}": lambda r: motion_error(r, FEWER_SUBSTEPS),
        "stress cases passed": lambda r: passed(table(r, "stability")),
        "poses rendered right": lambda r: passed(table(r, "stability", "poses")),
    }
    for beginning, name in OMISSIONS.items():
        rows[f"left out: {name}"] = lambda r, b=beginning: omission(r, b)
    heads = [f"{model}, {NAMES[device]}" for model, device in reports]
    print_row("", heads)
    print_row("---", ["---"] * len(heads))
    for name, cell in rows.items():
        print_row(name, map(cell, reports.values()))


def print_stability(reports, devices):
    """A column for each device, all models together."""
    materials = "4 materials (default, E = 10⁹ Pa, compliance 0, ν = 0.499)"
    models = len(reports) // len(devices)
    head = f"{models} models × {materials}: passed, slowest to recover"
    print_row(head, [NAMES[device] for device in devices])
    print_row("---", ["---"] * len(devices))
    mine = {d: [r for (_, device), r in reports.items() if device == d] for d in devices}
    for name, cases in CASES.items():
        cells = []
        for device in devices:
            rows = [row for r in mine[device] for row in table(r, "stability")]
            rows = [row for row in rows if row["case"] in cases]
            times = [row["recovery_seconds"] for row in rows if row["recovery_seconds"]]
            slowest = f", {max(times):.1f} s" if times and "masses" not in name else ""
            cells.append(f"{passed(rows)}{slowest}")
        print_row(name, cells)
    cells = []
    for device in devices:
        rows = [row for r in mine[device] for row in table(r, "stability", "poses")]
        flat = sum(not row["shown"] for row in rows)
        worst = min(row["psnr"] for row in rows)
        cells.append(f"{passed(rows)} ({flat} flat ones show nothing), worst {worst:.0f} dB")
    print_row("the renderer in nine such poses, against float64 (45 dB and 8/255 owed)", cells)


def print_row(name, cells):
    print(f"| {name} | {' | '.join(cells)} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="that holds MODEL-DEVICE/report.json")
    parser.add_argument("--models", nargs="+", required=True)
    parser.add_argument("--devices", nargs="+", required=True, choices=NAMES)
    arguments = parser.parse_args()
    reports = {
        (model, device): json.loads(
            (arguments.folder / f"{model}-{device}" / "report.json").read_text()
        )
        for device in arguments.devices
        for model in arguments.models
    }
    print_together(reports)
    print()
    print_stability(reports, arguments.devices)


if __name__ == "__main__":
    main()
