"""The parts of the section on omissions: together they are all rows."""

import subprocess
import tempfile

import pytest

from deformrf.core.lab.effort import EFFORTS
from deformrf.core.lab.omissions.measure import Part, parts
from deformrf.core.lab.omissions.rows import FILE, NOT_MEASURED, START, UNITS

BRIEF = EFFORTS[True, True]._replace(
    frame_size=16, view_count=1, frame_turns=3, step_turns=3, start_turns=1
)
FAILED = "Measuring it failed: "


def test_parts_have_titles_and_take_time(ball, tmp_path, device):
    planned = parts(ball, tmp_path / "no such file.npz", device, BRIEF)
    assert all(part.title and part.seconds > 0.0 for part in planned)
    assert len({part.title for part in planned}) == len(planned)


def test_together_they_are_all_rows(ball, ball_file, device):
    planned = parts(ball, ball_file, device, BRIEF)[:-1]  # compiling takes seconds
    rows = [row for part in planned for row in part.run()]
    assert {row.group for row in rows} == set(UNITS)
    assert len({(row.name, row.unit) for row in rows}) == len(rows) > 15
    for row in rows:
        assert row.why.endswith(".") and row.unit in ("ms", "MB", "s")
        assert (row.saving is None) == (row.verdict == NOT_MEASURED)
        assert FAILED not in row.why


def test_what_fails_is_a_row_and_the_others_are_measured(ball, ball_file, tmp_path, monkeypatch):
    planned = {part.title: part for part in parts(ball, tmp_path / "none.npz", "cpu", BRIEF)}
    (no_start,) = planned["starts with what others import"].run()
    (no_file,) = planned["the model file"].run()
    assert (no_start.group, no_start.unit) == (START, "s")
    assert (no_file.group, no_file.unit) == (FILE, "MB")
    for row in (no_start, no_file):
        assert row.verdict == NOT_MEASURED and row.left_out is None
        assert row.why.startswith(FAILED) and "none.npz" in row.why
        assert str(tmp_path) not in row.why and "Traceback" not in row.why
    planned = {part.title: part for part in parts(ball, ball_file, "cpu", BRIEF)}
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "no such folder"))
    (full,) = planned["kernels of another device"].run()
    assert full.why.startswith(FAILED) and str(tmp_path) not in full.why
    (drag,) = planned["dynamics: gravity and a ground"].run()
    assert drag.verdict != NOT_MEASURED


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(28, "No space left on device", "/tmp/a b/model.npz"), "'model.npz'."),
        (RuntimeError("first\nCan't read C:\\me\\x.npz in m/s."), "Can't read x.npz in m/s."),
        (subprocess.TimeoutExpired("/bin/x", 3.0), "'x' timed out after 3.0 seconds."),
        (RuntimeError(), "RuntimeError."),
    ],
)
def test_a_failure_is_said_in_a_line_without_folders(error, reason):
    def fail():
        raise error

    (row,) = Part("a thing", FILE, 1.0, fail).run()
    assert row.why.startswith(FAILED) and row.why.endswith(reason)
    assert "\n" not in row.why and "/tmp" not in row.why


def test_a_mistake_of_the_program_is_no_failure_of_the_machine():
    with pytest.raises(ZeroDivisionError):
        Part("a thing", FILE, 1.0, lambda: 1 // 0).run()


def test_a_quick_look_is_smaller():
    for on_cpu in (True, False):
        quick, full = EFFORTS[on_cpu, True], EFFORTS[on_cpu, False]
        assert quick.frame_size < full.frame_size and quick.start_turns < full.start_turns
        assert quick.compilations == 1 and full.compilations > 2
        assert all(few <= many for few, many in zip(quick, full, strict=True))
