"""The tables of the documentation are those that the script makes of stored results."""

import importlib.util
import json
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent / "benchmarks" / "tables.py"
RESULTS = SCRIPT.parents[2] / "docs" / "results"


@pytest.fixture(scope="module")
def tables():
    spec = importlib.util.spec_from_file_location(SCRIPT.stem, SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_pages_have_the_tables_of_the_stored_results(tables):
    for page in tables.PAGES:
        text = page.read_text(encoding="utf-8")
        assert tables.with_tables(text) == text, f"{page}: run python {SCRIPT}"


def test_every_stored_result_is_shown_and_says_what_measured_it(tables):
    shown = {name for page in tables.PAGES for name in tables.MARKED.findall(page.read_text())}
    for path in RESULTS.glob("*.json"):
        assert path.stem in shown, f"{path.name} stands in no page"
        result = json.loads(path.read_text(encoding="utf-8"))
        assert result["date"] and result["commit"], path.name


def test_a_changed_number_is_written(tables):
    page = "a\n<!-- table quality -->\nold\n<!-- end -->\nb\n"
    made = tables.with_tables(page)
    assert made.startswith("a\n<!-- table quality -->\n| data | ") and made.endswith("end -->\nb\n")
    assert "old" not in made and tables.with_tables(made) == made


def test_numbers_have_their_columns_format(tables):
    made = tables.markdown(
        ["name", {"name": "x", "format": ",.1f"}], [["a", -1234.56], ["b", None]]
    )
    assert made.splitlines()[2:] == ["| a | −1,234.6 |", "| b |  |"]
