"""The tables of the documentation are those that the script makes of stored results."""

import json

import tables

RESULTS = tables.DOCS / "results"


def test_pages_have_the_tables_of_the_stored_results():
    for page in tables.PAGES:
        text = page.read_text(encoding="utf-8")
        assert tables.with_tables(text) == text, f"{page}: run python tests/benchmarks/tables.py"


def test_every_stored_result_is_shown_and_says_what_measured_it():
    shown = {name for page in tables.PAGES for name in tables.MARKED.findall(page.read_text())}
    for path in RESULTS.glob("*.json"):
        assert path.stem in shown, f"{path.name} stands in no page"
        result = json.loads(path.read_text(encoding="utf-8"))
        assert result["date"] and result["commit"], path.name
