"""A report as Markdown, as GitHub shows it; its pictures and whole tables lie beside it.

Texts of a report are plain: what would be markup in them is escaped.  Numbers have three
significant digits: 62.3, 1,234, 2.3·10⁻⁵.  Files for programs have all of them.
"""

import math
import re

import numpy as np

from ..stopwatch import Spread
from .contents import Report, Section, Table

MARKUP = re.compile(r"([\\`*_\[\]<>|~&#])")
LEFT, RIGHT = ":--", "--:"
NOTHING = "–"
PASS, FAIL = "pass", "FAIL"
PLAIN_FROM, PLAIN_BELOW = 1e-3, 1e5  # magnitudes that are written without a power of ten
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def page(report: Report) -> str:
    """The whole page; the notice stands above everything else."""
    blocks = [f"# {escaped(report.title)}"]
    if report.notice:
        blocks.append(f"> **{escaped(report.notice)}**")
    if report.facts:
        rows = [map(escaped, fact) for fact in report.facts.items()]
        blocks.append(_grid(["", ""], [LEFT] * 2, rows))
    if report.sections:
        rows = [
            [
                f"[{escaped(section.title)}](#{anchor(section.title)})",
                _cell(passed(section.passed)),
                escaped(section.findings[0]) if section.findings else "",
            ]
            for section in report.sections
        ]
        blocks.append(_grid(["section", "", "finding"], [LEFT] * 3, rows))
    for section in report.sections:
        blocks += _section(section)
    return "\n\n".join(blocks) + "\n"


def _section(section: Section) -> list[str]:
    blocks = [f"## {escaped(section.title)}"]
    if section.passed is not None:
        blocks.append(f"Result: {_cell(passed(section.passed))}")
    if section.findings:
        blocks.append("\n".join(f"- {escaped(finding)}" for finding in section.findings))
    for figure in section.figures:
        caption = escaped(figure.caption)
        blocks += [f"![{caption}]({figure.name}.png)", f"*{caption}*"]
    for table in section.tables:
        blocks += _table(table)
    if section.method:
        summary = "<summary>How it was measured</summary>"
        blocks += [f"<details>{summary}", *map(escaped, section.method), "</details>"]
    return blocks


def _table(table: Table) -> list[str]:
    """Caption, rows, and what has to be said below them."""
    headings, rows, notes = table.headings, [], []
    for row in table.rows:
        marked = getattr(row, "default", False)
        rows.append([_cell(text(getattr(row, name), name), marked) for name in headings])
    if any(getattr(row, "default", False) for row in table.rows):
        notes.append("The default is in bold.")
    notes.append(f"As a file: [{escaped(table.name)}.csv]({table.name}.csv)")
    columns = ([getattr(row, name) for row in table.rows] for name in headings)
    sides = [RIGHT if _is_numeric(column) else LEFT for column in columns]
    grid = [_grid(map(escaped, headings.values()), sides, rows)] if rows else []
    return [escaped(table.caption), *grid, " ".join(notes)]


def _grid(headings, sides, rows) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (headings, sides, *rows))


def _cell(words: str, marked=False) -> str:
    return f"**{escaped(words)}**" if words and (marked or words == FAIL) else escaped(words)


def _is_numeric(column) -> bool:
    known = [value for value in column if value is not None]
    return bool(known) and not any(isinstance(value, (str, bool, np.bool_)) for value in known)


def escaped(words: str) -> str:
    """Plain text, in one line."""
    return MARKUP.sub(r"\\\1", " ".join(words.split()))


def anchor(title: str) -> str:
    """The name that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def text(value, name="") -> str:
    """A table's value, of the attribute of that name."""
    match value:
        case None:
            return NOTHING
        case str():
            return value
        case bool() | np.bool_():
            return passed(value) if name == "passed" else "yes" if value else "no"
        case Spread(count=1):
            return number(value.median)
        case Spread():
            to = " to " if value.low < 0.0 else "–"  # a dash beside a minus sign
            return f"{number(value.median)} ({number(value.low)}{to}{number(value.high)})"
        case _:
            return number(value)


def passed(value: bool | None) -> str:
    """A result as "pass" or "FAIL"; empty for a section without a criterion."""
    return "" if value is None else PASS if value else FAIL


def number(value) -> str:
    """An integer whole, anything else with three significant digits."""
    if isinstance(value, (int, np.integer)):
        return f"{value:,}".replace("-", "−")
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "∞" if value > 0.0 else "−∞"
    if value == 0.0:
        return "0"
    sign = "−" if value < 0.0 else ""
    mantissa, exponent = f"{abs(value):.2e}".split("e")
    rounded = float(f"{mantissa}e{exponent}")
    if PLAIN_FROM <= rounded < PLAIN_BELOW:
        return f"{sign}{abs(value):,.0f}" if rounded >= 100.0 else f"{sign}{rounded:#.3g}"
    ten = f"10{str(int(exponent)).translate(SUPERSCRIPTS)}"
    mantissa = mantissa.rstrip("0").rstrip(".")
    return sign + (ten if mantissa == "1" else f"{mantissa}·{ten}")
