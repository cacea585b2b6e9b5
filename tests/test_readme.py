"""The pages name files that exist, and what README has one type works."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from readme_lines import NO_INDEX, type_all
from xwindow import missing_tools

ROOT = Path(__file__).resolve().parent.parent
PATTERNS = ("*.md", "assets/*.md", "docs/**/*.md")
PAGES = [page for pattern in PATTERNS for page in sorted(ROOT.glob(pattern))]
LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]+))?\)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page):
    for target, heading in LINK.findall(page.read_text(encoding="utf-8")):
        path = page.parent / target if target else page
        assert path.exists(), f"{page.name} links to {target}"
        assert not heading or heading in headings(path), f"{page.name} links to {target}#{heading}"


def headings(page):
    """The anchors of a page's headings, as they are where repositories are shown."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    titles = re.findall(r"^#+ (.*)$", text, re.M)
    return [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles]


@pytest.mark.usefixtures("window")
@pytest.mark.skipif(bool(missing_tools()), reason="needs Xvfb and xdotool")
def test_each_line_of_readme_works(tmp_path):
    """In a fresh clone, with an empty HOME; `make soak` trains as well, and on other Pythons."""
    if subprocess.run(["git", "-C", ROOT, "rev-parse", "HEAD"], capture_output=True).returncode:
        pytest.skip("this is no clone")
    for one in type_all(tmp_path, sys.executable):
        if "DEFORMRF_REQUIRE_INDEX" not in os.environ and NO_INDEX.search(one.printed):
            pytest.skip("no package index can be reached from here")
        assert one.is_right(trains=False), f"{one.typed}: {one.code}\n{one.printed}"


def expanded(name):
    """The paths that `tests/test_{a,b}.py` stands for."""
    before, brace, rest = name.partition("{")
    if not brace:
        return [name]
    choices, _, after = rest.partition("}")
    return [f"{before}{choice}{after}" for choice in choices.split(",")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_tests_and_benchmarks_that_a_page_names_exist(page):
    # Not those of a commit: what they measured stands, and git has them.
    named = re.findall(r"tests/[\w/*{},]+\.py(?!` of [0-9a-f]{7})", page.read_text("utf-8"))
    absent = [name for names in map(expanded, named) for name in names if not any(ROOT.glob(name))]
    assert not absent, f"{page.name} names {absent}"
