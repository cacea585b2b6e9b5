"""The jobs of a report: nothing is done before they run, and together they are all rows."""

from deformrf.core.study.omissions import Effort, effort, omissions
from deformrf.core.study.omitted import GROUPS, NOT_MEASURED

BRIEF = Effort(16, 1, 3, 3, 1, (1.0, 1.0, 1.0, 1.0, 1.0))


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


def test_a_quick_look_is_smaller():
    for name in ("cpu", "cuda:0"):
        quick, full = effort(name, True), effort(name, False)
        assert quick.image_size < full.image_size and quick.start_turns < full.start_turns
        assert sum(quick.job_seconds) < sum(full.job_seconds)
