"""A report as files: a page, the same as Markdown and as JSON, its tables and its pictures.

report.html     everything, in one file that needs nothing else
report.md       the same for GitHub, with links to the files below
report.json     what programs read: all values with all digits, null where one isn't finite
<table>.csv     all rows of a table; empty where there is no value
<figure>.png
"""

import csv
import io
import json
import math
from base64 import b64encode
from contextlib import suppress
from dataclasses import is_dataclass
from html import escape
from itertools import pairwise
from pathlib import Path
from string import Template

import numpy as np
from markdown_it import MarkdownIt

from ....core.base.paths import program_version, whole_files
from . import markdown
from .contents import Report, Table, record

FORMAT = "deformrf-report"
FORMAT_VERSION = 2
TEMPLATE = Path(__file__).with_name("page.html")


def is_complete(folder) -> bool:
    """Whether a folder holds a complete report."""
    return bool(_last(folder).get("complete"))


def write(report: Report, folder) -> list[Path]:
    """Write all files into a folder; they appear when all are complete.

    Files of an older report there are removed or replaced.  Whenever the program is killed, the
    folder has files of one report only: the older one's go first, but for its page, which needs
    no other; then the new page takes its place, and the other files follow.

    Returns:
        Their paths, the page's last.

    Raises:
        OSError: The folder or a file can't be written.
    """
    sections = report.sections
    figures = [figure for section in sections for figure in section.figures]
    tables = [table for section in sections for table in section.tables]
    files = {f"{figure.name}.png": figure.png for figure in figures}
    files |= {f"{table.name}.csv": table_as_csv(table).encode() for table in tables}
    keys = {section.key for section in sections}
    names = [*files, "report.json", "report.md", "report.html"]
    unique = len(files) == len(tables) + len(figures) and len(keys) == len(sections)
    assert unique, f"not unique: {names} {keys}"
    text = markdown.page(report)
    values = as_json(report) | {"files": names}
    files["report.json"] = (json.dumps(values, indent=1, allow_nan=False) + "\n").encode()
    files["report.md"], files["report.html"] = text.encode(), as_html(report, text).encode()

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    # report.json, which names the others, goes last and comes before them.
    order = [*names[:-3], "report.md", "report.json", "report.html"][::-1]
    older = [str(name) for name in _last(folder).get("files", []) if name not in order[:2]]
    # Nothing outside the folder, whatever stands there.
    older = [folder / name for name in older if Path(name).name == name]
    older = [path for path in [*older, folder / "report.json"] if path.is_file()]
    with whole_files([folder / name for name in order], older) as partials:
        for partial, name in zip(partials, order, strict=True):
            partial.write_bytes(files[name])
    return [folder / name for name in names]


def as_json(report: Report) -> dict:
    """The contents of report.json: plain values, None for nan and inf."""
    sections = {
        section.key: {
            "title": section.title,
            "findings": section.findings,
            "passed": section.passed,
            "seconds": section.seconds,
            "values": section.values,
            "tables": {table.name: table.rows for table in section.tables},
        }
        for section in report.sections
    }
    return _plain(
        {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "program_version": program_version(),
            "facts": report.facts,
            "complete": report.complete,
            "sections": sections,
        }
    )


def table_as_csv(table: Table) -> str:
    """All rows of a table, with a line of names above them."""
    records = [record(row) for row in table.rows]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, records[0] if records else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return stream.getvalue()


def as_html(report: Report, text: str) -> str:
    """The Markdown `text` of a report as a page without scripts and without other files."""
    parser = MarkdownIt("commonmark", {"html": True, "xhtmlOut": False}).enable("table")
    tokens = parser.parse(text)
    for heading, words in pairwise(tokens):
        if heading.type == "heading_open":
            title = "".join(child.content for child in words.children)
            heading.attrSet("id", markdown.anchor(title))
    body = parser.renderer.render(tokens, parser.options, {})
    body = body.replace("<table>", '<div class="table"><table>')
    body = body.replace("</table>", "</table></div>")
    body = body.replace(f"<strong>{markdown.FAIL}", f'<strong class="fail">{markdown.FAIL}')
    for figure in (figure for section in report.sections for figure in section.figures):
        content = f"data:image/png;base64,{b64encode(figure.png).decode()}"
        body = body.replace(f'src="{figure.name}.png"', f'src="{content}"')
    template = Template(TEMPLATE.read_text(encoding="utf-8"))
    return template.substitute(title=escape(report.title), version=program_version(), body=body)


def _plain(value):
    match value:
        case dict():
            return {_plain(name): _plain(inner) for name, inner in value.items()}
        case list() | tuple():
            return [_plain(inner) for inner in value]
        case np.ndarray() | np.generic():
            return _plain(value.tolist())
        case float() if not math.isfinite(value):
            return None
        case _ if is_dataclass(value):
            return _plain(record(value))
        case _:
            return value


def _last(folder) -> dict:
    """The contents of the report.json in a folder; empty if it is not from this program."""
    with suppress(OSError, ValueError):
        values = json.loads((Path(folder) / "report.json").read_text(encoding="utf-8"))
        ours = isinstance(values, dict) and values.get("format") == FORMAT
        if ours and isinstance(values.get("files", []), list):
            return values
    return {}
