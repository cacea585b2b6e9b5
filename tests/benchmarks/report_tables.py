"""Write the tables of docs/report/README.md from the stored reports: what they say together.

    python tests/benchmarks/report_tables.py [--check]

A line `<!-- table NAME -->` in the page begins a table and `<!-- end -->` ends it.  --check
writes nothing and ends with 1 if the page is not what this script would write.
"""

import argparse
import json
import re
import sys
from pathlib import Path

from deformrf.core.deform import XpbdOptions

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "report"
PAGE = FOLDER / "README.md"
MODELS = ("helmet", "chair", "foxrig", "shiny")
DEVICES = {"h100": "one H100", "cpu": "two CPU cores"}
COMMITS = "17582c83 on an H100, 8d9f06c1 on two CPU cores"  # that recorded the reports
MARKED = re.compile(r"<!-- table (\w+) -->\n.*?<!-- end -->", re.DOTALL)
SUBSTEPS, FEWER_SUBSTEPS = XpbdOptions().substep_count, 15
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
    "volume constraints of": "volumes of tets whose neighbors hold them",
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
        if (row.get("compliance", "material"), row["count"]) == ("material", count)
    }
    if not rows:
        return "–"
    return f"{rows['static']['of_motion']:.2f}, {rows['dynamic']['of_motion']:.2f}"


def frame(report):
    rows = [row for row in table(report, "dynamics") if row["default"]]
    return f"{rows[0]['frame_ms']:.3g}" if rows[0]["count"] == SUBSTEPS else "–"


def passed(rows):
    return f"{sum(row['passed'] for row in rows)} of {len(rows)}"


def omission(report, beginning):
    if "left_out" not in report["sections"]:  # it was interrupted
        return ""
    rows = [row for row in table(report, "left_out") if row["name"].startswith(beginning)]
    if not rows or rows[0]["saving"] is None:
        return "–"
    row = rows[0]
    return f"{row['saving']:.3g} {row['unit']} of {row['with_it']:.3g}"


def together(reports):
    """A column for each model and device."""
    cells = {
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
        cells[f"left out: {name}"] = lambda r, b=beginning: omission(r, b)
    heads = ["", *(f"{model}, {DEVICES[device]}" for model, device in reports)]
    return [heads, *([name, *map(cell, reports.values())] for name, cell in cells.items())]


def stability(reports):
    """A column for each device, all models together."""
    materials = "4 materials (default, E = 10⁹ Pa, compliance 0, ν = 0.499)"
    mine = {d: [r for (_, device), r in reports.items() if device == d] for d in DEVICES}
    rows = [[f"{len(MODELS)} models × {materials}: passed, slowest to recover", *DEVICES.values()]]
    for name, cases in CASES.items():
        cells = []
        for device in DEVICES:
            found = [row for r in mine[device] for row in table(r, "stability")]
            found = [row for row in found if row["case"] in cases]
            times = [row["recovery_seconds"] for row in found if row["recovery_seconds"]]
            slowest = f", {max(times):.1f} s" if times and "masses" not in name else ""
            cells.append(f"{passed(found)}{slowest}")
        rows.append([name, *cells])
    cells = []
    for device in DEVICES:
        found = [row for r in mine[device] for row in table(r, "stability", "poses")]
        flat = sum(not row["shown"] for row in found)
        worst = min(row["psnr"] for row in found)
        cells.append(f"{passed(found)} ({flat} flat ones show nothing), worst {worst:.0f} dB")
    return [*rows, ["the renderer in nine such poses (45 dB and 8/255 owed)", *cells]]


TABLES = {"together": together, "stability": stability}


def with_tables(text):
    """The page's text, its marked tables made anew."""
    reports = {
        (model, device): json.loads((FOLDER / f"{model}-{device}" / "report.json").read_text())
        for device in DEVICES
        for model in MODELS
    }
    dates = ", ".join(sorted({report["facts"]["date"] for report in reports.values()}))

    def made(found):
        rows = TABLES[found.group(1)](reports)
        lines = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
        body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        measured = f"Measured: {dates}, commits {COMMITS}."
        return f"<!-- table {found.group(1)} -->\n{body}\n\n{measured}\n<!-- end -->"

    return MARKED.sub(made, text)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare, and write nothing")
    check, text = parser.parse_args().check, PAGE.read_text(encoding="utf-8")
    if check and with_tables(text) != text:
        sys.exit(f"{PAGE.name}: run python tests/benchmarks/report_tables.py")
    if not check:
        PAGE.write_text(with_tables(text), encoding="utf-8")


if __name__ == "__main__":
    main()
