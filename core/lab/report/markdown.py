"""A report as Markdown, as GitHub shows it; its pictures and whole tables lie beside it.

Texts of a report are plain: what would be markup in them is escaped.
"""

import re

from .formatting import FAIL, passed, printed
from .parts import Figure, Section, Table

MARKUP = re.compile(r"([\\`*_\[\]<>|~&#])")
LEFT, RIGHT = ":--", "--:"


def page(title: str, facts: dict[str, str], sections: list[Section], notice: str | None) -> str:
    """The whole page; a notice stands above everything else."""
    blocks = [f"# {escaped(title)}"]
    if notice:
        blocks.append(f"> **{escaped(notice)}**")
    if facts:
        rows = [map(escaped, fact) for fact in facts.items()]
        blocks.append(_table(["", ""], [LEFT] * 2, rows))
    if sections:
        rows = [
            [
                f"[{escaped(part.title)}](#{anchor(part.title)})",
                _cell(passed(part.passed)),
                escaped(part.findings[0]) if part.findings else "",
            ]
            for part in sections
        ]
        blocks.append(_table(["section", "", "finding"], [LEFT] * 3, rows))
    for part in sections:
        blocks += _section(part)
    return "\n\n".join(blocks) + "\n"


def escaped(words: str) -> str:
    """Plain text, in one line."""
    return MARKUP.sub(r"\\\1", " ".join(words.split()))


def _section(part: Section) -> list[str]:
    blocks = [f"## {escaped(part.title)}"]
    if part.passed is not None:
        blocks.append(f"Result: {_cell(passed(part.passed))}")
    if part.findings:
        blocks.append("\n".join(f"- {escaped(finding)}" for finding in part.findings))
    blocks += map(_figure, part.figures)
    for table in part.tables:
        blocks += _printed_table(table)
    if part.method:
        summary = "<summary>How it was measured</summary>"
        blocks += [f"<details>{summary}", *map(escaped, part.method), "</details>"]
    return blocks


def _figure(figure: Figure) -> str:
    return f"![{escaped(figure.caption)}]({figure.name}.png)\n\n*{escaped(figure.caption)}*"


def _printed_table(table: Table) -> list[str]:
    shown = printed(table)
    rows = [
        [_cell(cell, marked) for cell in row]
        for row, marked in zip(shown.rows, shown.marked, strict=True)
    ]
    headings = [escaped(heading) for heading in shown.headings]
    sides = [RIGHT if numeric else LEFT for numeric in shown.numeric]
    file = f"As a file: [{escaped(table.name)}.csv]({table.name}.csv)"
    grid = [_table(headings, sides, rows)] if rows else []
    return [escaped(table.caption), *grid, " ".join([*shown.notes, file])]


def _table(headings, sides, rows) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (headings, sides, *rows))


def _cell(words: str, marked=False) -> str:
    return f"**{escaped(words)}**" if words and (marked or words == FAIL) else escaped(words)


def anchor(title: str) -> str:
    """The name that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
