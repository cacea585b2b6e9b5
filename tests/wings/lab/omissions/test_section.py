"""The section of what is left out: figures of all that was measured, questions and answers."""

import io

import pytest
from PIL import Image

from deformrf.wings.lab.effort import EFFORTS
from deformrf.wings.lab.omissions import switch as omitted
from deformrf.wings.lab.omissions.section import section_of
from deformrf.wings.lab.omissions.switch import Switch, measured
from deformrf.wings.lab.stopwatch import in_turns

EFFORT = EFFORTS[True, True]


def row(name, with_it, without, unit="ms"):
    turns = in_turns(with_it, without), omitted.NONE
    return measured(Switch(name, omitted.RENDERING, unit, "Because it is idle.", lambda: turns))


def mystery():
    def fail():
        raise RuntimeError("nobody tells")

    return measured(Switch("a mystery", omitted.FILE, "MB", "Because it is idle.", fail))


@pytest.fixture
def rows():
    return [
        row("a large share", [10.0, 11.0], [2.0, 2.5]),
        row("a small share", [10.0, 11.0], [9.0, 9.5]),
        row("no share", [10.0, 11.0], [11.0, 10.0]),
        row("no byte", [3.0], [3.0], unit="MB"),
        row("a loss", [2.0, 2.5], [10.0, 11.0]),
        mystery(),
    ]


def test_savings_are_counted(rows):
    first = section_of(rows, EFFORT).findings[0]
    assert "2 save" in first and "2 nothing" in first and "1 cost" in first


def test_what_saves_nothing_is_asked_why(rows):
    nothing, byte, loss, mystery = section_of(rows, EFFORT).findings[1:]
    assert "Leaving out no share saves nothing that can be measured" in nothing
    assert "(with it 10.1 to 10.9, without 10.1 to 10.9 ms)" in nothing
    assert "with it 3 to 3" in byte and "Leaving out a loss costs 8.25 ms" in loss
    for finding in (nothing, byte, loss):
        assert finding.endswith("Why is it left out? Because it is idle.")
    assert mystery == "Not measured: a mystery. Measuring it failed: nobody tells."


def test_the_table_has_all_rows_and_the_picture_what_was_measured(rows):
    found = section_of(rows, EFFORT)
    (table,), (figure,) = found.tables, found.figures
    assert (found.key, table.name, figure.name) == ("left_out",) * 3
    assert table.rows == rows and found.passed is None
    few = Image.open(io.BytesIO(section_of(rows[:2], EFFORT).figures[0].png))
    every = Image.open(io.BytesIO(figure.png))
    assert every.height > few.height and every.convert("L").getextrema()[0] < 128


def test_where_nothing_was_measured_there_is_no_picture(rows):
    found = section_of(rows[-1:], EFFORT)
    assert not found.figures and len(found.tables[0].rows) == 1
    assert found.findings[0].startswith("Of 0 things")
