"""The tables of docs/report are those of the stored reports."""

import report_tables


def test_the_page_has_the_tables_of_the_reports():
    text = report_tables.PAGE.read_text(encoding="utf-8")
    assert set(report_tables.MARKED.findall(text)) == set(report_tables.TABLES)
    assert report_tables.with_tables(text) == text
    assert report_tables.with_tables(text.replace("41 of 41", "40 of 41", 1)) == text


def test_stored_reports_link_to_files_that_exist():
    for page in report_tables.FOLDER.glob("*/report.md"):
        linked = report_tables.re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
        assert linked and all((page.parent / name).exists() for name in linked), page
