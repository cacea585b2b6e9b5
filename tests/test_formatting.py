"""Values as text: three digits, a dash for nothing, and the words of results."""

import re
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pytest

from deformrf.core.lab.report.formatting import number, passed, printed, text
from deformrf.core.lab.report.parts import Table
from deformrf.core.lab.stopwatch import Timing


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0, "0"),
        (7, "7"),
        (1234, "1,234"),
        (-1234567, "−1,234,567"),
        (np.int32(99999), "99,999"),
        (0.0, "0"),
        (-0.0, "0"),
        (1.0, "1.00"),
        (62.34, "62.3"),
        (9.996, "10.0"),
        (99.96, "100"),
        (1234.5, "1,234"),
        (99940.0, "99,940"),
        (99990.0, "10⁵"),
        (1.5e6, "1.5·10⁶"),
        (0.5, "0.500"),
        (0.001, "0.00100"),
        (0.0009999, "0.00100"),
        (0.0009994, "9.99·10⁻⁴"),
        (2.3e-5, "2.3·10⁻⁵"),
        (-1e-12, "−10⁻¹²"),
        (np.float32(0.25), "0.250"),
        (float("nan"), "NaN"),
        (float("inf"), "∞"),
        (-np.float64("inf"), "−∞"),
    ],
)
def test_numbers_have_three_digits(value, expected):
    assert number(value) == expected


def read(words):
    """The number that a text says."""
    sign, mantissa, power = re.fullmatch(r"(−?)([\d.,]*)·?(?:10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?", words).groups()
    digits = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    magnitude = float(mantissa.replace(",", "") or 1) * 10.0 ** int(
        (power or "0").translate(digits)
    )
    return -magnitude if sign else magnitude


def test_a_number_is_rounded_by_half_a_percent_at_most():
    values = np.random.default_rng().normal(size=300) * 10.0 ** np.linspace(-12, 12, 300)
    assert [read(number(value)) for value in values] == pytest.approx(values, rel=0.00501)


def test_other_values_are_words():
    assert text(None) == "–" and text("a | b") == "a | b"
    assert (text(True), text(np.bool_(False))) == ("yes", "no")
    results = [text(value, "passed") for value in (True, np.False_, None)]
    assert results == ["pass", "FAIL", "–"]
    assert text(Timing(1.342, 1.3, 1.4, 9)) == "1.34 (1.30–1.40)"
    assert text(Timing(-0.02, -0.05, 0.01, 9)) == "−0.0200 (−0.0500 to 0.0100)"
    assert text(Timing(5.3, 5.3, 5.3, 1)) == "5.30"
    assert (passed(True), passed(False), passed(None)) == ("pass", "FAIL", "")


@dataclass(frozen=True)
class Row:
    error: Annotated[float | None, "error [%]"]
    name: Annotated[str, "case"]
    default: bool
    hidden: int = 1


def test_a_table_shows_what_has_a_heading():
    rows = [Row(0.1, "a", False), Row(None, "b", True), Row(0.3, "c", False)]
    shown = printed(Table("t", "T.", rows))
    assert shown.headings == ["error [%]", "case"] and shown.numeric == [True, False]
    assert shown.rows == [["0.100", "a"], ["–", "b"], ["0.300", "c"]]
    assert shown.marked == [False, True, False] and shown.notes == ["The default is in bold."]


def test_a_table_may_show_its_first_rows_only():
    rows = [Row(0.5, "a", False)] * 1200
    shown = printed(Table("t", "T.", rows, first=2))
    assert len(shown.rows) == 2 and shown.notes == ["The first 2 of 1,200 rows."]
    none = printed(Table("t", "T.", []))
    assert none.rows == [] and none.notes == []


def test_a_column_without_a_value_is_not_shown():
    shown = printed(Table("t", "T.", [Row(None, "a", False), Row(None, "b", False)]))
    assert shown.headings == ["case"] and shown.rows == [["a"], ["b"]]
