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


def test_a_changed_number_is_written():
    page = "a\n<!-- table quality -->\nold\n<!-- end -->\nb\n"
    made = tables.with_tables(page)
    assert made.startswith("a\n<!-- table quality -->\n| data | ") and made.endswith("end -->\nb\n")
    assert "old" not in made and tables.with_tables(made) == made


def test_numbers_have_their_columns_format():
    made = tables.markdown(
        ["name", {"name": "x", "format": ",.1f"}], [["a", -1234.56], ["b", None]]
    )
    assert made.splitlines()[2:] == ["| a | −1,234.6 |", "| b |  |"]
