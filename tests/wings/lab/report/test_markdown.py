"""Markdown as a parser of its own reads it: texts come back, and numbers have three digits."""

import re
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
import pytest
from markdown_it import MarkdownIt

from deformrf.wings.lab.report import markdown
from deformrf.wings.lab.report.contents import Figure, Report, Section, Table
from deformrf.wings.lab.report.markdown import escaped, number, passed, text
from deformrf.wings.lab.stopwatch import Spread

ODD = "a|b `c` *d* _e_ <script>f</script> [g](h) ~~i~~ &lt; # \\ \\| **"
FIGURE = Figure("fig_1", "σ [1/m]: *so* | so.", b"")


@dataclass(frozen=True)
class Row:
    case: Annotated[str, "case [|]"]
    size: Annotated[float, "size"]
    passed: Annotated[bool, "result"]
    default: bool


TABLE = Table(
    "cases_all",
    "Cases | all.",
    [Row(ODD, 0.25, False, False), Row("plain", 2.0, True, True), Row("", 1.0, True, True)],
)
SECTIONS = [
    Section("odd", "What's left out: 1_2", [ODD, "More."], [ODD], [TABLE], [FIGURE], False),
    Section("bare", "Bare", []),
]


def page(facts, sections, complete=True):
    return markdown.page(Report("T", facts, sections, complete))


def parsed(words):
    return MarkdownIt("commonmark").enable(["table", "strikethrough"]).parse(words)


def plain(inline):
    """What a reader sees of a token's content."""
    shown = ("text", "text_special")
    return "".join(child.content for child in inline.children if child.type in shown)


def cells(tokens):
    """Rows of all tables, each a list of inline tokens."""
    rows = []
    for before, token in pairwise(tokens):
        if before.type == "tr_open":
            rows.append([])
        if before.type in ("th_open", "td_open"):
            rows[-1].append(token)
    return rows


def test_escaped_text_reads_as_it_was():
    (_, inline, _) = parsed(escaped(ODD))
    assert plain(inline) == ODD
    assert {child.type for child in inline.children} <= {"text", "text_special"}
    assert escaped("two\n\nlines") == "two lines"


def test_tables_are_whole():
    tokens = parsed(page({"a|b": ODD}, SECTIONS))
    facts, overview, table = [], [], []
    for row in cells(tokens):
        {2: facts, 3: overview if len(overview) < 3 else table}[len(row)].append(row)
    assert [plain(cell) for cell in facts[1]] == ["a|b", ODD]
    assert [plain(cell) for cell in overview[1]] == ["What's left out: 1_2", "FAIL", ODD]
    assert [plain(cell) for cell in overview[2]] == ["Bare", "", ""]
    assert [[plain(cell) for cell in row] for row in table] == [
        ["case [|]", "size", "result"],
        [ODD, "0.250", "FAIL"],
        ["plain", "2.00", "pass"],
        ["", "1.00", "pass"],
    ]


def test_each_line_of_a_table_has_as_many_cells():
    lines = page({"a|b": ODD}, SECTIONS).replace("\\\\", "").replace("\\|", "")
    blocks = [block.splitlines() for block in lines.split("\n\n") if block.startswith("|")]
    assert len(blocks) == 3
    for block in blocks:
        assert len({line.count("|") for line in block}) == 1


def test_default_and_failure_are_bold():
    lines = page({}, SECTIONS).splitlines()
    assert "| **plain** | **2.00** | **pass** |" in lines
    assert "|  | **1.00** | **pass** |" in lines
    assert "Result: **FAIL**" in lines
    assert any(line.endswith("| 0.250 | **FAIL** |") for line in lines)


def test_links_lead_to_headings_and_files():
    tokens = parsed(page({}, SECTIONS))
    children = [child for token in tokens for child in token.children or []]
    targets = [child.attrs["href"] for child in children if child.type == "link_open"]
    assert targets == ["#whats-left-out-1_2", "#bare", "cases_all.csv"]
    (image,) = (child for child in children if child.type == "image")
    assert image.attrs["src"] == "fig_1.png" and plain(image) == FIGURE.caption


def test_an_interrupted_report_says_so_at_the_top():
    lines = page({"a": "b"}, [], complete=False).splitlines()
    assert lines[:2] == ["# T", ""] and lines[2].startswith("> **This report was interrupted")


def table_lines(rows):
    """The lines of a table of these rows: its grid, and what is said below it."""
    whole = page({}, [Section("s", "S", [], tables=[Table("t", "T.", rows)])])
    _, _, lines = whole.partition("\n\nT.\n\n")
    *grid, notes = (line for line in lines.splitlines() if line)
    return grid, notes.removesuffix("As a file: [t.csv](t.csv)").strip()


@dataclass(frozen=True)
class Error:
    error: Annotated[float | None, "error [%]"]
    name: Annotated[str, "case"]
    default: bool
    hidden: int = 1


def test_a_table_shows_what_has_a_heading():
    rows = [Error(0.1, "a", False), Error(None, "b", True), Error(0.3, "c", False)]
    grid, notes = table_lines(rows)
    assert grid[:2] == [r"| error \[%\] | case |", "| --: | :-- |"]
    assert grid[2:] == ["| 0.100 | a |", "| **–** | **b** |", "| 0.300 | c |"]
    assert notes == "The default is in bold."
    assert table_lines([]) == ([], "")


def test_a_column_without_a_value_is_not_shown():
    grid, _ = table_lines([Error(None, "a", False), Error(None, "b", False)])
    assert grid == ["| case |", "| :-- |", "| a |", "| b |"]


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
    assert text(Spread(1.342, 1.3, 1.4, 9)) == "1.34 (1.30–1.40)"
    assert text(Spread(-0.02, -0.05, 0.01, 9)) == "−0.0200 (−0.0500 to 0.0100)"
    assert text(Spread(5.3, 5.3, 5.3, 1)) == "5.30"
    assert (passed(True), passed(False), passed(None)) == ("pass", "FAIL", "")
