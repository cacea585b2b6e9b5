"""A report's files: they say the same, in ways that their readers understand."""

import csv
import json
import os
from base64 import b64encode
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest

from deformrf.core.base.paths import program_version
from deformrf.wings.lab.report import markdown, plots
from deformrf.wings.lab.report.contents import INTERRUPTED, Figure, Report, Section, Table
from deformrf.wings.lab.report.writing import is_complete, write
from deformrf.wings.lab.stopwatch import Share, Spread

ODD = "a | <script>alert(\"b\")</script> & 'c'"


@dataclass(frozen=True)
class Row:
    case: Annotated[str, "case"]
    frame: Annotated[Spread | None, "frame [ms]"]
    error: Annotated[float | None, "error"]
    count: int
    passed: Annotated[bool | None, "result"]
    default: bool


@dataclass(frozen=True)
class Limit:
    name: str
    frame: Spread
    relative: Share
    shares: tuple


ROWS = [
    Row(ODD, Spread(1.3421, 1.301, 1.399, 20), 2.3e-5, 1234, True, True),
    Row("second", None, float("nan"), 5, False, False),
    Row("third", Spread(7.0, 6.0, 8.0, 3), float("inf"), 6, None, False),
    Row("fourth", Spread(9.0, 8.0, 10.0, 3), None, np.int64(7), True, False),
]


def read_json(path):
    """The file's values; what JSON doesn't know is an error."""

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


class Page(HTMLParser):
    """What a page refers to, what it shows, and which elements it opens and closes."""

    EMPTY = ("meta", "img")

    def __init__(self, path):
        super().__init__()
        self.references, self.ids, self.classes, self.rows = [], [], [], []
        self.tags, self.open, self.words, self.alternatives = set(), [], "", []
        self.feed(path.read_text(encoding="utf-8"))
        self.close()

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.tags.add(tag)
        if tag not in self.EMPTY:
            self.open.append(tag)
        self.references += [attributes[name] for name in ("src", "href") if name in attributes]
        self.ids += [attributes["id"]] if "id" in attributes else []
        self.alternatives += [attributes["alt"]] if tag == "img" else []
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        self.classes.append((tag, attributes.get("class")))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, words):
        if {"style", "title"} & set(self.open):
            return
        self.words += words
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += words


@pytest.fixture(scope="module")
def png():
    figure = plots.new_figure(2.0, 1.0)
    figure.subplots().plot([1.0, 2.0])
    return plots.png(figure)


@pytest.fixture(scope="module")
def report(png):
    values = {
        "limits": [
            Limit(
                "x",
                Spread(1.0, 0.5, 2.0, 4),
                relative=Share(90.0, 80.0, 101.0, 4),
                shares=(float("nan"), np.float32(0.5)),
            )
        ],
        "array": np.array([[1.0, np.inf], [2.0, 3.0]]),
        "flag": np.bool_(True),
        np.int64(3): None,
    }
    first = Section(
        key="first",
        title=f"First {ODD}",
        findings=[f"Found {ODD}.", "Second finding."],
        method=[f"Measured {ODD}."],
        tables=[Table("first", f"Caption {ODD}.", ROWS)],
        figures=[Figure("curve", f"Curve {ODD}.", png)],
        passed=False,
        values=values,
        seconds=12.5,
    )
    empty = Table("nothing", "Of nothing.", [])
    second = Section("second", "Second", ["Good."], tables=[empty], passed=True)
    return Report(ODD, {"model": "ball", "command": f"x {ODD}"}, [first, second], True)


@pytest.fixture(scope="module")
def folder(report, tmp_path_factory):
    folder = tmp_path_factory.mktemp("written") / "new" / "report"
    paths = write(report, folder)
    assert sorted(paths) == sorted(folder.iterdir())
    return folder


def test_files_are_those_of_the_report(folder, png):
    names = {"report.html", "report.json", "report.md", "first.csv", "nothing.csv", "curve.png"}
    assert {path.name for path in folder.iterdir()} == names
    assert (folder / "curve.png").read_bytes() == png


def test_json_has_all_values(folder):
    values = read_json(folder / "report.json")
    assert list(values) == [
        *("format", "format_version", "program_version", "facts", "complete", "sections"),
        "files",
    ]
    assert set(values["files"]) == {path.name for path in folder.iterdir()}
    assert values["format"] == "deformrf-report" and values["format_version"] == 2
    assert values["program_version"] == program_version() and values["complete"] is True
    assert values["facts"] == {"model": "ball", "command": f"x {ODD}"}
    assert list(values["sections"]) == ["first", "second"]
    first = values["sections"]["first"]
    assert list(first) == ["title", "findings", "passed", "seconds", "values", "tables"]
    assert (first["seconds"], values["sections"]["second"]["seconds"]) == (12.5, None)
    assert first["findings"] == [f"Found {ODD}.", "Second finding."] and first["passed"] is False
    limit = {"name": "x", "frame_ms": 1.0, "frame_ms_low": 0.5, "frame_ms_high": 2.0}
    relative = {"relative_percent": 90.0, "relative_percent_low": 80.0}
    relative |= {"relative_percent_high": 101.0, "relative_repeats": 4}
    assert first["values"] == {
        "limits": [{**limit, **relative, "frame_repeats": 4, "shares": [None, 0.5]}],
        "array": [[1.0, None], [2.0, 3.0]],
        "flag": True,
        "3": None,
    }
    rows = first["tables"]["first"]
    assert rows[0]["frame_ms"] == 1.3421 and rows[0]["error"] == 2.3e-5 and len(rows) == 4
    assert [row["error"] for row in rows[1:]] == [None, None, None]
    assert rows[3]["count"] == 7 and rows[2]["passed"] is None


def test_csv_has_all_rows(folder):
    with open(folder / "first.csv", newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == [
        *("case", "frame_ms", "frame_ms_low", "frame_ms_high", "frame_repeats"),
        *("error", "count", "passed", "default"),
    ]
    assert [row["case"] for row in rows] == [ODD, "second", "third", "fourth"]
    assert float(rows[0]["frame_ms"]) == 1.3421 and rows[1]["frame_ms"] == ""
    assert [row["error"] for row in rows] == ["2.3e-05", "nan", "inf", ""]
    assert [row["passed"] for row in rows] == ["True", "False", "", "True"]
    assert (folder / "nothing.csv").read_text() == "\n"


def test_the_page_needs_nothing_else(folder, report, png):
    page = Page(folder / "report.html")
    assert page.open == [] and not {"script", "link"} & page.tags
    image = f"data:image/png;base64,{b64encode(png).decode()}"
    anchors = [f"#{markdown.anchor(section.title)}" for section in report.sections]
    assert page.references == [*anchors, image, "first.csv", "nothing.csv"]
    assert {anchor[1:] for anchor in anchors} <= set(page.ids)
    assert len(set(page.ids)) == len(page.ids)
    style = (folder / "report.html").read_text().partition("</style>")[0]
    assert "url(" not in style and "@import" not in style


def test_the_page_shows_what_was_written(folder, report):
    page = Page(folder / "report.html")
    section = report.sections[0]
    assert page.alternatives == [section.figures[0].caption]
    for words in (
        report.title,
        section.title,
        *section.findings,
        *section.method,
        section.tables[0].caption,
    ):
        assert words in page.words
    assert page.words.count(section.findings[0]) == 2  # in the summary, too
    assert INTERRUPTED not in page.words
    assert page.rows[-5:] == [
        ["case", "frame [ms]", "error", "result"],
        [ODD, "1.34 (1.30–1.40)", "2.3·10⁻⁵", "pass"],
        ["second", "–", "NaN", "FAIL"],
        ["third", "7.00 (6.00–8.00)", "∞", "–"],
        ["fourth", "9.00 (8.00–10.0)", "–", "pass"],
    ]
    failed = ("strong", "fail")  # in the summary, the section and the second row
    assert page.classes.count(failed) == 3


def test_an_interrupted_report_says_so(tmp_path):
    write(Report("Part", {}, [], complete=False, missing=("this", "that")), tmp_path)
    page = Page(tmp_path / "report.html")
    notice = f"{INTERRUPTED} Missing: this, that."
    assert notice in page.words and "blockquote" in page.tags
    assert notice in (tmp_path / "report.md").read_text()
    assert read_json(tmp_path / "report.json")["complete"] is False


def test_names_are_unique(report, tmp_path):
    tables, figures = report.sections[0].tables, report.sections[0].figures
    for twice in (
        [Section("a", "A", [], tables=tables), Section("b", "B", [], tables=tables)],
        [Section("a", "A", [], figures=[*figures, *figures])],
        [Section("a", "A", []), Section("a", "B", [])],
    ):
        with pytest.raises(AssertionError, match="not unique"):
            write(Report("Twice", {}, twice, True), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_files_are_replaced_all_together_or_not_at_all(report, tmp_path):
    (tmp_path / "report.json").write_text("old")
    (tmp_path / "report.html").mkdir()  # can't be replaced by a file
    with pytest.raises(OSError):
        write(report, tmp_path)
    assert (tmp_path / "report.json").read_text() == "old"
    assert {path.name for path in tmp_path.iterdir()} == {"report.json", "report.html"}


def test_what_an_older_report_had_more_is_removed(report, tmp_path):
    """And nothing else, whatever its report.json says."""
    beside, mine = tmp_path / "beside.png", tmp_path / "report" / "mine.csv"
    paths = write(report, tmp_path / "report")
    for path in (beside, mine):
        path.write_text("kept")
    listed = json.loads((tmp_path / "report" / "report.json").read_text())
    listed["files"] += ["../beside.png"]
    (tmp_path / "report" / "report.json").write_text(json.dumps(listed))
    assert is_complete(tmp_path / "report") and not is_complete(tmp_path)
    fewer = write(Report("Part", {}, [], complete=False), tmp_path / "report")
    assert {path.name for path in (tmp_path / "report").iterdir()} == {
        "mine.csv",
        *(path.name for path in fewer),
    }
    assert len(fewer) == 3 < len(paths) and beside.exists()
    assert not is_complete(tmp_path / "report")


def numbered(number, figure_count):
    """A report whose number is in each of its files."""
    figures = [Figure(f"f{k}", "", f"n {number}.".encode()) for k in range(figure_count)]
    table = Table("t", "T", [Row(f"n {number}.", None, None, 0, None, False)])
    sections = [Section("a", "A", [f"n {number}."], tables=[table], figures=figures)]
    return Report("Numbered", {"n": f"n {number}."}, sections, complete=True)


@pytest.mark.parametrize("counts", [(3, 2), (2, 3)])
def test_a_kill_never_leaves_files_of_two_reports(tmp_path, monkeypatch, counts):
    """At any moment, and the page is there; the next report is whole."""
    steps, unlink, replace = [], Path.unlink, os.replace

    def step(do):
        if len(steps) == last:
            raise KeyboardInterrupt  # what is done now is what `finally` does
        steps.append(1)
        do()

    for last in range(100):
        folder = tmp_path / str(last)
        write(numbered(1, counts[0]), folder)
        (folder / "mine.csv").write_text("kept")
        steps.clear()
        with monkeypatch.context() as patch:
            patch.setattr(os, "replace", lambda *paths: step(lambda: replace(*paths)))
            patch.setattr(
                Path,
                "unlink",
                lambda path, missing_ok=False: (
                    unlink(path, missing_ok)
                    if path.name.startswith(".")
                    else step(lambda: unlink(path))
                ),
            )
            try:
                write(numbered(2, counts[1]), folder)
                break
            except KeyboardInterrupt:
                pass
        left = {path.name: path.read_text() for path in folder.iterdir() if path.suffix != ".part"}
        assert left.pop("mine.csv") == "kept" and "report.html" in left
        assert (
            len({number for text in left.values() for number in (1, 2) if f"n {number}." in text})
            == 1
        )
        paths = write(numbered(3, 1), folder)
        assert sorted(folder.iterdir()) == sorted([*paths, folder / "mine.csv"])
        assert all("n 3." in path.read_text() for path in paths)
    assert last >= 10
