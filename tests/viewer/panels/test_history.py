"""The panel's list of what can be undone."""

import pytest

from deformrf.viewer.document import Journal
from deformrf.viewer.document.history.journal import Step

pytestmark = pytest.mark.gl


def lines(count, cursor):
    from deformrf.viewer.panels.bend import shown_steps

    journal = Journal(None)
    journal.steps = [Step(f"step {n}", n, {}) for n in range(count)]
    journal.cursor = cursor
    return shown_steps(journal)


def test_nothing_was_done_yet():
    assert lines(0, 0) == [("nothing was changed yet", True)]


@pytest.mark.parametrize("count, cursor, first", [(3, 2, 0), (20, 20, 12), (20, 10, 6), (20, 0, 0)])
def test_the_steps_around_the_cursor_are_shown(count, cursor, first):
    found = lines(count, cursor)
    assert len(found) == min(count, 8)
    assert found[0][0] == f"{first + 1}  step {first}"
    assert [undone for _, undone in found] == [first + n >= cursor for n in range(len(found))]
