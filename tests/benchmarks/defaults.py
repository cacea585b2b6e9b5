"""What the rule gives for several models together: the defaults of a device.

python tests/benchmarks/defaults.py docs/report/*-h100/report.json
python tests/benchmarks/defaults.py docs/report/*-cpu/report.json

Each argument is a deformrf-report of one model, all on the same device.  A setting has to be
within the bounds for every model; times are relative to the default's of the same report.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from deformrf.core.study import own_mesh, rendering, rule


def rendering_choice(reports):
    """Settings that all have, the worst error and the times of each, and which one is chosen."""
    tables = [table(report, "rendering") for report in reports]
    times = [report["sections"]["rendering"]["values"]["times"] for report in reports]
    names = [name for name in tables[0] if all(name in t for t in tables)]  # levels differ
    names = [name for name in names if tables[0][name]["candidate"]]
    errors, turns = [], []
    for name in names:
        worst = min(t[name]["worst_psnr"] for t in tables)
        largest = max(t[name]["largest"] for t in tables)
        errors.append(-worst if largest <= rendering.LARGEST else np.inf)
        relative = [np.array(t[name]) / np.median(t["default"]) for t in times]
        turns.append(np.concatenate(relative))
    chosen = rule.cheapest(turns, errors, -rendering.BOUND)
    if chosen is None:
        print("no setting is within the bounds for all models")
        return
    for number, name in enumerate(names):
        largest = max(t[name]["largest"] for t in tables)
        worst = min(t[name]["worst_psnr"] for t in tables)
        slower = (turns[number] > turns[chosen]).mean()
        print(
            f"{name:20} time {np.median(turns[number]):5.3f}, slower in {100 * slower:3.0f} %,"
            f" worst view {worst:5.1f} dB, largest {largest:5.1f}/255"
            f"{'   <- the rule' if number == chosen else ''}"
        )


def substeps_choice(reports):
    """The least number of substeps that is within the bound for every model."""
    worst = {}
    for report in reports:
        for row in report["sections"]["dynamics"]["tables"]["dynamics"]:
            if (row["scheme"], row["compliance"]) == ("substeps", "material"):
                worst[row["count"]] = max(worst.get(row["count"], 0.0), row["of_motion"])
    counts = sorted(worst)
    errors = [worst[count] / 100.0 for count in counts]
    chosen = rule.cheapest([[count] for count in counts], errors, own_mesh.BOUND)
    for number, count in enumerate(counts):
        mark = "   <- the rule" if number == chosen else ""
        print(f"{count:4} substeps: at most {worst[count]:.3g} % of the motion{mark}")


def table(report, key):
    return {row["setting"]: row for row in report["sections"][key]["tables"][key]}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("reports", nargs="+", type=Path, help="report.json of each model")
    arguments = parser.parse_args()
    reports = [json.loads(path.read_text()) for path in arguments.reports]
    print("models:", "; ".join(report["facts"]["model"] for report in reports))
    rendering_choice(reports)
    substeps_choice(reports)


if __name__ == "__main__":
    main()
