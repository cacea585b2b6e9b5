r"""What the rule gives for several models together: the defaults of a device.

python tests/benchmarks/defaults.py docs/report/*-h100/report.json \
    --errors docs/report/*/report.json

Times are those of the first reports, one of each model, all on one device, over the default's in
the same turn.  Errors are a matter of the setting and not of the device.  Of images the worst of
the reports behind --errors counts, by default that of the first ones; of substeps the worst of the
first ones.  Each model has its own errors, and a user's is none of ours.
A setting takes the default's place only if the turns show that it is cheaper: by two standard
errors of the median.  Else which one is chosen would be a matter of chance.
Ends with 1 if the program's defaults are not what the rule gives.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from deformrf.core.deform import XpbdOptions
from deformrf.wings.lab.dynamics import measure as dynamics
from deformrf.wings.lab.rendering import section as rendering

ERROR_OF_MEDIAN = np.sqrt(0.5 * np.pi)  # over that of the mean, of a normal distribution


def rendering_choice(reports, judged):
    """Settings of default mode that all reports have, their shares of time and errors.

    Returns:
        The name of the rule's choice, or None.
    """
    tables = [table(report) for report in judged]
    timed = [report["sections"]["rendering"]["values"]["times"] for report in reports]
    names = [
        name
        for name, row in tables[0].items()
        if row["candidate"] and all(name in rows for rows in [*tables, *timed])
    ]
    worst = [min(rows[name]["worst_psnr"] for rows in tables) for name in names]
    largest = [
        max(rows[name][pixels] for rows in tables for pixels in ("largest", "largest_anywhere"))
        for name in names
    ]
    default = names.index("default")
    shares = [rendering.shares([rows[name] for name in names], default) for rows in timed]
    times = np.concatenate(shares, axis=1)
    within = np.array(largest) <= rendering.LARGEST
    errors = np.where(within, -np.array(worst), np.inf)
    if within[default] and worst[default] >= rendering.BOUND:
        spread = ERROR_OF_MEDIAN * times.std(axis=1) / np.sqrt(times.shape[1])
        cheaper = np.median(times, axis=1) + 2.0 * spread < 1.0
        cheaper[default] = True
        errors = np.where(cheaper, errors, np.inf)
    chosen = rendering.cheapest(times, errors, -rendering.BOUND, default)
    for number, name in enumerate(names):
        low, median, high = np.percentile(times[number], [10, 50, 90])
        print(
            f"{name:24} time {median:.3f} ({low:.2f} to {high:.2f}), worst view"
            f" {worst[number]:4.1f} dB, largest {largest[number]:5.1f}/255"
            f"{'   <- the rule' if number == chosen else ''}"
        )
    return None if chosen is None else names[chosen]


def substeps_choice(judged):
    """The least number of substeps that is within the bound for every model; None if none is."""
    worst = {}
    for report in judged:
        for row in steps(report):
            worst.setdefault(row["count"], []).append(row["of_motion"])
    counts = sorted(count for count, errors in worst.items() if len(errors) == 2 * len(judged))
    errors = [max(worst[count]) for count in counts]
    bound = 100.0 * dynamics.BOUND
    chosen = rendering.cheapest([[count] for count in counts], errors, bound)
    print(f"at most {bound:g} % is owed")
    for number, count in enumerate(counts):
        mark = "   <- the rule" if number == chosen else ""
        print(f"{count:4} substeps: at most {errors[number]:.3g} % of the motion{mark}")
    return None if chosen is None else counts[chosen]


def steps(report):
    return report["sections"]["dynamics"]["tables"]["dynamics"]


def table(report):
    return {row["setting"]: row for row in report["sections"]["rendering"]["tables"]["rendering"]}


def read(paths):
    return [json.loads(path.read_text()) for path in paths]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("reports", nargs="+", type=Path, help="report.json of each model")
    parser.add_argument("--errors", nargs="+", type=Path, help="those whose images count")
    arguments = parser.parse_args()
    reports = read(arguments.reports)
    judged = read(arguments.errors or arguments.reports)
    print("times of:", "; ".join(f"{r['facts']['model']}, {r['facts']['device']}" for r in reports))
    chosen = rendering_choice(reports, judged), substeps_choice(reports)
    sys.exit(chosen != ("default", XpbdOptions().substep_count))


if __name__ == "__main__":
    main()
