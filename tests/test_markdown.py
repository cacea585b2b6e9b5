"""Markdown as a parser of its own reads it: texts come back, whatever is in them."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

from markdown_it import MarkdownIt

from deformrf.core.lab.report.markdown import escaped, page
from deformrf.core.lab.report.parts import Figure, Section, Table

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
    tokens = parsed(page("T", {"a|b": ODD}, SECTIONS, None))
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
    lines = page("T", {"a|b": ODD}, SECTIONS, None).replace("\\\\", "").replace("\\|", "")
    blocks = [block.splitlines() for block in lines.split("\n\n") if block.startswith("|")]
    assert len(blocks) == 3
    for block in blocks:
        assert len({line.count("|") for line in block}) == 1


def test_default_and_failure_are_bold():
    lines = page("T", {}, SECTIONS, None).splitlines()
    assert "| **plain** | **2.00** | **pass** |" in lines
    assert "|  | **1.00** | **pass** |" in lines
    assert "Result: **FAIL**" in lines
    assert any(line.endswith("| 0.250 | **FAIL** |") for line in lines)


def test_links_lead_to_headings_and_files():
    tokens = parsed(page("T", {}, SECTIONS, None))
    children = [child for token in tokens for child in token.children or []]
    targets = [child.attrs["href"] for child in children if child.type == "link_open"]
    assert targets == ["#whats-left-out-1_2", "#bare", "cases_all.csv"]
    (image,) = (child for child in children if child.type == "image")
    assert image.attrs["src"] == "fig_1.png" and plain(image) == FIGURE.caption


def test_an_interrupted_report_says_so_at_the_top():
    words = page("T", {"a": "b"}, [], "It was interrupted.")
    assert words.splitlines()[:3] == ["# T", "", "> **It was interrupted.**"]
