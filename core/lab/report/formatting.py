"""Values as people read them, the same on the page and in Markdown.

Three significant digits: 62.3, 1,234, 2.3·10⁻⁵.  Files for programs have all of them.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..stopwatch import Timing
from .parts import Table

NOTHING = "–"
PASS, FAIL = "pass", "FAIL"
PLAIN_FROM, PLAIN_BELOW = 1e-3, 1e5  # magnitudes that are written without a power of ten
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Printed:
    """A table as text."""

    headings: list[str]
    numeric: list[bool]  # whether a column holds numbers, which are aligned at their right
    rows: list[list[str]]
    marked: list[bool]  # whether a row is that of the default
    notes: list[str]  # what has to be said below it, in sentences


def printed(table: Table) -> Printed:
    """The table's first rows, those attributes of them that have a heading."""
    rows = table.rows[: table.first]
    marked = [bool(getattr(row, "default", False)) for row in rows]
    columns = [[getattr(row, name) for row in rows] for name in table.headings]
    notes = ["The default is in bold."] if any(marked) else []
    if len(rows) < len(table.rows):
        notes.append(f"The first {number(len(rows))} of {number(len(table.rows))} rows.")
    return Printed(
        headings=list(table.headings.values()),
        numeric=[_is_numeric(column) for column in columns],
        rows=[[text(getattr(row, name), name) for name in table.headings] for row in rows],
        marked=marked,
        notes=notes,
    )


def text(value, name="") -> str:
    """A table's value, of the attribute of that name."""
    match value:
        case None:
            return NOTHING
        case str():
            return value
        case bool() | np.bool_():
            return passed(value) if name == "passed" else "yes" if value else "no"
        case Timing(count=1):
            return number(value.median)
        case Timing():
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
    rounded, power = float(f"{mantissa}e{exponent}"), int(exponent)
    if PLAIN_FROM <= rounded < PLAIN_BELOW:
        if rounded >= 100.0:
            return f"{sign}{abs(value):,.0f}"
        return f"{sign}{rounded:.{2 - power}f}"
    ten = f"10{str(power).translate(SUPERSCRIPTS)}"
    mantissa = mantissa.rstrip("0").rstrip(".")
    return sign + (ten if mantissa == "1" else f"{mantissa}·{ten}")


def _is_numeric(column) -> bool:
    known = [value for value in column if value is not None]
    return bool(known) and not any(isinstance(value, (str, bool, np.bool_)) for value in known)
