"""The jobs of a report: nothing is done before they run, and together they are all rows."""

import subprocess
import tempfile

import pytest

from deformrf.core.lab.omissions.measure import Effort, Job, effort, omissions
from deformrf.core.lab.omissions.rows import FILE, GROUPS, NOT_MEASURED, START

BRIEF = Effort(16, 1, 3, 3, 1, 1, (1.0, 1.0, 1.0, 1.0, 1.0))
FAILED = "Measuring it failed: "


def test_jobs_have_titles_and_take_time(ball, tmp_path, device):
    jobs = omissions(ball, tmp_path / "no such file.npz", device, BRIEF)
    assert all(job.title and job.seconds > 0.0 for job in jobs)
    assert len({job.title for job in jobs}) == len(jobs)


def test_together_they_are_all_rows(ball, ball_file, device):
    jobs = omissions(ball, ball_file, device, BRIEF)[:-1]  # compiling takes seconds
    rows = [row for job in jobs for row in job.run()]
    assert {row.group for row in rows} == set(GROUPS)
    assert len({(row.name, row.unit) for row in rows}) == len(rows) > 15
    for row in rows:
        assert row.why.endswith(".") and row.unit in ("ms", "MB", "s")
        assert (row.saving is None) == (row.verdict == NOT_MEASURED)
        assert FAILED not in row.why


def test_what_fails_is_a_row_and_the_others_are_measured(ball, ball_file, tmp_path, monkeypatch):
    jobs = {job.title: job for job in omissions(ball, tmp_path / "none.npz", "cpu", BRIEF)}
    (no_start,) = jobs["starts with what others import"].run()
    (no_file,) = jobs["the model file"].run()
    assert (no_start.group, no_start.unit) == (START, "s")
    assert (no_file.group, no_file.unit) == (FILE, "MB")
    for row in (no_start, no_file):
        assert row.verdict == NOT_MEASURED and row.left_out is None
        assert row.why.startswith(FAILED) and "none.npz" in row.why
        assert str(tmp_path) not in row.why and "Traceback" not in row.why
    jobs = {job.title: job for job in omissions(ball, ball_file, "cpu", BRIEF)}
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "no such folder"))
    (full,) = jobs["the model file"].run()
    assert full.why.startswith(FAILED) and str(tmp_path) not in full.why
    (drag,) = jobs["dynamics: gravity"].run()
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

    (row,) = Job("a thing", FILE, 1.0, fail).run()
    assert row.why.startswith(FAILED) and row.why.endswith(reason)
    assert "\n" not in row.why and "/tmp" not in row.why


def test_a_mistake_of_the_program_is_no_failure_of_the_machine():
    with pytest.raises(ZeroDivisionError):
        Job("a thing", FILE, 1.0, lambda: 1 // 0).run()


def test_a_quick_look_is_smaller():
    for name in ("cpu", "cuda:0"):
        quick, full = effort(name, True), effort(name, False)
        assert quick.image_size < full.image_size and quick.start_turns < full.start_turns
        assert quick.compilations == 1 and full.compilations > 2
        assert sum(quick.job_seconds) < sum(full.job_seconds)
