"""Starts with torch and without it: fresh interpreters."""

import sys

import pytest

from deformrf.wings.lab.omissions import starts
from deformrf.wings.lab.omissions.switch import NONE, NOT_MEASURED, SAVES, measured

BALLAST = 600_000_000  # bytes


@pytest.fixture(scope="module")
def rows(ball_file):
    ballast = bytearray(b"x" * BALLAST)  # of the process that starts others
    found = [measured(switch) for switch in starts.start_switches(ball_file, "cpu", turns=1)]
    del ballast
    return found


def test_viewing_does_not_import_torch_which_takes_time(rows):
    row = rows[0]
    assert (row.change, row.unit) == (NONE, "s")
    assert row.saving.median == pytest.approx(row.with_it.median - row.without.median)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a process's own peak")
def test_memory_is_that_of_the_fresh_process(rows):
    row = rows[1]
    assert row.verdict == SAVES and row.saving.median > 50.0
    assert 50.0 < row.without.median < BALLAST / 1e6


def replaced(monkeypatch, result):
    """Let each start print this; a list of what the starts imported first."""
    asked = []

    def run(_, path, device, *first):
        asked.append(first)
        return result(asked)

    monkeypatch.setattr(starts, "run_python", run)
    return asked


def test_both_rows_are_of_the_same_starts_and_the_first_does_not_count(monkeypatch):
    asked = replaced(monkeypatch, lambda asked: [float(len(asked) > 2), 1.0, False, "an image"])
    seconds, _ = (measured(switch) for switch in starts.start_switches("model.npz", "cpu", 2))
    assert len(asked) == 2 * 3
    assert (seconds.with_it.low, seconds.without.low, seconds.with_it.count) == (1.0, 1.0, 2)


def test_what_is_imported_anyway_is_said(monkeypatch):
    replaced(monkeypatch, lambda asked: [1.0, 100.0, True, "an image"])
    for switch in starts.start_switches("model.npz", "cpu", 2):
        assert measured(switch).change.startswith("it is not left out")


def test_where_nobody_tells_the_memory_the_row_says_so(monkeypatch):
    replaced(monkeypatch, lambda asked: [1.0, None, False, "an image"])
    _, memory = (measured(switch) for switch in starts.start_switches("model.npz", "cpu", 1))
    assert memory.verdict == NOT_MEASURED and memory.saving is None and memory.unit == "MB"


def test_a_start_that_fails_says_why():
    row = measured(starts.start_switches("nowhere.npz", "cpu", 1)[0])
    assert row.verdict == NOT_MEASURED and "no model file" in row.why
