"""Starts with what is left out: fresh interpreters, with and without it."""

import sys

import pytest

from deformrf.wings.lab.omissions import starts
from deformrf.wings.lab.omissions.measure import NONE, NOT_MEASURED, NOTHING, SAVES

BALLAST = 600_000_000  # bytes


@pytest.fixture(scope="module")
def rows(ball_file):
    ballast = bytearray(b"x" * BALLAST)  # of the process that starts others
    found = starts.import_rows(ball_file, "cpu", turns=1)
    del ballast
    return {(row.name, row.unit): row for row in found}


def test_viewing_imports_neither_torch_nor_what_reports_need(rows):
    assert len(rows) == 4 and all(row.left_out and row.change == NONE for row in rows.values())


def test_the_first_start_of_each_way_does_not_count(monkeypatch):
    runs = []

    def run(_, *arguments):
        runs.append(arguments[2:])
        seconds = 100.0 if runs.count(arguments[2:]) == 1 else 2.0 + len(arguments)
        return [seconds, 1.0, [], "an image"]

    monkeypatch.setattr(starts, "_run", run)
    seconds, *_ = starts.import_rows("model.npz", "cpu", turns=2)
    assert len(runs) == 3 * 3 and seconds.with_it.count == 2
    assert (seconds.with_it.high, seconds.without.high) == (5.0, 4.0)


def test_importing_torch_takes_time(rows):
    row = rows["torch, at the start", "s"]
    assert row.verdict == SAVES and row.without.median > 0.1
    assert row.saving.median == pytest.approx(row.with_it.median - row.without.median)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a process's own peak")
def test_memory_is_that_of_the_fresh_process(rows):
    row = rows["torch, in memory", "MB"]
    assert row.verdict == SAVES and row.saving.median > 50.0
    assert 50.0 < row.without.median < BALLAST / 1e6


def test_what_is_imported_anyway_is_not_left_out():
    runs = {
        way: [[1.0, 100.0, ["torch"], "an image"], [1.1, 100.0, ["torch"], "an image"]]
        for way in (starts.TORCH, ())
    }
    seconds, memory = starts.rows_of("torch", runs)
    assert not seconds.left_out and not memory.left_out
    assert memory.verdict == NOTHING and memory.why.startswith("It is imported anyway")


def test_where_nobody_tells_the_memory_the_row_says_so():
    run = [1.0, None, [], "an image"]
    runs = {way: [run] for way in (starts.TORCH, ())}
    _, memory = starts.rows_of("torch", runs)
    assert memory.verdict == NOT_MEASURED and memory.saving is None and memory.unit == "MB"


def test_kernels_of_another_device_take_time_to_compile():
    row = starts.kernel_row("cpu", 1)
    assert row.verdict == SAVES and row.saving.median > 0.05 and "CUDA" in row.name


def test_a_start_that_fails_says_why():
    with pytest.raises(RuntimeError, match="no model file"):
        starts.import_rows("nowhere.npz", "cpu", 1)
