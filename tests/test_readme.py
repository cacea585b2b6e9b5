"""The pages name files that exist, and README's map has the rooms of the tree."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PATTERNS = ("*.md", "assets/*.md", "docs/**/*.md")
PAGES = [page for pattern in PATTERNS for page in sorted(ROOT.glob(pattern))]
LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)(?:#[^)]*)?\)")


def mapped_paths():
    """The paths of the map, whose entries are indented below their folder."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^## Map\n+```\n(.*?)```", text, re.DOTALL | re.MULTILINE)
    folders = {}
    for line in block.splitlines():
        depth = len(line) - len(line.lstrip())
        folders[depth] = line.split()[0].rstrip("/")
        yield ROOT.joinpath(*(name for d, name in sorted(folders.items()) if d <= depth))


def test_the_map_is_that_of_the_tree():
    mapped = set(mapped_paths())
    missing = [str(path.relative_to(ROOT)) for path in mapped if not path.exists()]
    assert not missing, f"README's map has {missing}, which are not in the tree"
    rooms = {path.parent for path in (ROOT / "core").glob("*/__init__.py")}
    rooms |= {path.parent for path in (ROOT / "core").glob("*/*/__init__.py")}
    rooms = {room for room in rooms if room.parent.name != "lab"}  # one line for all of it
    absent = [str(room.relative_to(ROOT)) for room in rooms - mapped]
    assert not absent, f"README's map lacks {absent}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name} links to {target}"


def expanded(name):
    """The paths that `tests/test_{a,b}.py` stands for."""
    before, brace, rest = name.partition("{")
    if not brace:
        return [name]
    choices, _, after = rest.partition("}")
    return [f"{before}{choice}{after}" for choice in choices.split(",")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_tests_and_benchmarks_that_a_page_names_exist(page):
    named = re.findall(r"tests/(?:benchmarks/)?[\w*{},]+\.py", page.read_text(encoding="utf-8"))
    absent = [name for names in map(expanded, named) for name in names if not any(ROOT.glob(name))]
    assert not absent, f"{page.name} names {absent}"
