"""Write the tables of the documentation from stored results.

    python tests/benchmarks/tables.py

A line `<!-- table NAME -->` in one of PAGES begins a table and `<!-- end -->` ends it.  What stands
between them is made of docs/results/NAME.json: the table, and a line that says what measured
it.

A result has `columns` and `rows`.  A column is a name, or a name and the format of its numbers.
`command`, `hardware`, `date` and `commit` say how the numbers came about: the commit is the one
that recorded them.  A cell that is null is empty.
"""

import csv
import json
import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = (DOCS.parent / "README.md", DOCS / "performance.md", DOCS / "rigs.md")
COMPLIANCES = ("0", "material")  # those that the table of xpbd_error shows
MARKED = re.compile(r"<!-- table (\w+) -->\n.*?<!-- end -->", re.DOTALL)


def markdown(columns, rows):
    """A table; columns are names, or have a name and the format of their numbers."""
    columns = [{"name": c, "format": ""} if isinstance(c, str) else c for c in columns]
    lines = [[column["name"] for column in columns], ["---"] * len(columns)]
    for row in rows:
        lines.append([cell(value, c["format"]) for value, c in zip(row, columns, strict=True)])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def cell(value, number_format):
    if value is None:
        return ""
    return value if isinstance(value, str) else f"{value:{number_format}}".replace("-", "−")


def provenance(result):
    """The line beneath a table."""
    parts = [result["hardware"], result["date"]]
    if result["command"]:
        parts.insert(0, f"`{result['command']}`")
    if result["commit"]:
        parts.append(f"commit {result['commit']}")
    return f"\nMeasured: {', '.join(filter(None, parts))}.\n"


def xpbd_error():
    """Errors of substeps, in percent of the beam's size, from the CSV file of the CPU."""
    counts = (5, 10, 20, 50, 100)
    found = {}
    with (DOCS / "dynamics" / "error_cpu.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["scheme"] == "substeps" and row["compliance"] in COMPLIANCES:
                name = f"{row['scene']}, {row['lattice'].upper()}, {row['compliance']}"
                found.setdefault(name, {})[int(row["count"])] = row
    rows = []
    for name, by_count in found.items():
        errors = [percent(by_count[count]["rms"]) for count in counts]
        largest = " / ".join(percent(by_count[count]["largest"]) for count in (20, 50))
        rows.append([name, *errors, largest, f"{float(by_count[20]['milliseconds']):.2f}"])
    columns = ["scene, lattice, compliance [m/N]; substeps", *map(str, counts)]
    return {
        "command": "python tests/benchmarks/xpbd_error.py",
        "hardware": "two CPU cores",
        "date": "2026-11-22",
        "commit": "295a2e3",
        "columns": [*columns, "largest, 20 / 50", "ms a frame, 20"],
        "rows": rows,
    }


def percent(share):
    return f"{100.0 * float(share):.3g}"


def stored(name):
    if name == "xpbd_error":
        return xpbd_error()
    return json.loads((DOCS / "results" / f"{name}.json").read_text(encoding="utf-8"))


def with_tables(text):
    """The text, its marked tables made anew."""

    def table(found):
        name = found.group(1)
        result = stored(name)
        made = markdown(result["columns"], result["rows"]) + provenance(result)
        return f"<!-- table {name} -->\n{made}<!-- end -->"

    return MARKED.sub(table, text)


def main():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        page.write_text(with_tables(text), encoding="utf-8")


if __name__ == "__main__":
    main()
