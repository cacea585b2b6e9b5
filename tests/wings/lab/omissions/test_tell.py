"""The section of what is left out: figures of all that was measured, questions and answers."""

import io

import pytest
from PIL import Image

from deformrf.wings.lab.effort import EFFORTS
from deformrf.wings.lab.omissions import measure as omitted
from deformrf.wings.lab.omissions.steps import Drag
from deformrf.wings.lab.omissions.tell import section_of
from deformrf.wings.lab.report.parts import record
from deformrf.wings.lab.stopwatch import in_turns

EFFORT = EFFORTS[True, True]


def row(name, with_it, without, **kind):
    times = in_turns(with_it, without)
    change = kind.pop("change", omitted.NONE)
    return omitted.omission(name, omitted.RENDERING, times, change, "Because it is idle.", **kind)


@pytest.fixture
def rows():
    return [
        row("a large part", [10.0, 11.0], [2.0, 2.5]),
        row("a small part", [10.0, 11.0], [9.0, 9.5]),
        row("no part", [10.0, 11.0], [11.0, 10.0]),
        row("a chance", [10.0, 12.0], [9.0, 11.0]),
        row("no byte", [3.0], [3.0], unit="MB"),
        row("a loss", [2.0, 2.5], [10.0, 11.0]),
        row("a habit", [5.0, 6.0], [4.0, 4.5], left_out=False, change="30.0 dB, at most 9/255"),
        omitted.not_measured("a mystery", omitted.FILE, "Nobody tells."),
    ]


def test_savings_are_counted_and_the_largest_named(rows):
    first = section_of(rows, EFFORT).findings[0]
    assert "2 save" in first and "3 nothing" in first and "1 cost" in first
    assert "a large part" in first and "79 %" in first


def test_what_saves_nothing_is_asked_why(rows):
    findings = section_of(rows, EFFORT).findings[1:]
    assert not any("part" in finding for finding in findings if "no part" not in finding)
    assert "Leaving out no part saves nothing that can be measured" in findings[0]
    assert "(2 turns: with it 10.2 to 11.8, without 9.2 to 10.8 ms)" in findings[1]
    assert "(0 MB)" in findings[2]
    assert "Leaving out a loss costs 8.25 ms" in findings[3]
    for finding in findings[:4]:
        assert finding.endswith("Why is it left out? Because it is idle.")
    assert "Not left out: a habit" in findings[4] and "30.0 dB" in findings[4]
    assert findings[5] == "Not measured: a mystery. Nobody tells."


def test_the_method_has_the_numbers_of_what_was_done(rows, ball):
    method = " ".join(section_of(rows, EFFORT).method)
    assert f" {Drag(ball, 'cpu').solver.options.substep_count} substeps" in method
    assert f"Dynamics: {EFFORT.step_turns} turns" in method
    assert f"Start: {EFFORT.start_turns} turns" in method
    assert f"repeats: {EFFORT.compilations}." in method


def test_the_table_has_all_rows_and_the_picture_what_was_measured(rows):
    found = section_of(rows, EFFORT)
    (table,), (figure,) = found.tables, found.figures
    assert (found.key, table.name, figure.name) == ("left_out",) * 3
    assert table.rows == rows and found.passed is None
    assert set(table.headings) <= set(record(rows[0]))
    few = Image.open(io.BytesIO(section_of(rows[:2], EFFORT).figures[0].png))
    all_ = Image.open(io.BytesIO(figure.png))
    assert all_.height > few.height and all_.convert("L").getextrema()[0] < 128


def test_where_nothing_was_measured_there_is_no_picture(rows):
    found = section_of(rows[-1:], EFFORT)
    assert not found.figures and len(found.tables[0].rows) == 1
    assert found.findings[0].startswith("Of 0 rows")
