"""Processes of their own: what they say, and how they end."""

import time

import pytest

from deformrf.viewer.jobs import ProcessJob

SAYS = """
import sys
print('{"event": "frame", "frame": 1}{"event": "frame", "frame": 2}')
print("words")
print()
sys.exit(int(sys.argv[1]))
"""
WAITS = """
import signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: (print("is written", flush=True), sys.exit(130)))
print("ready", flush=True)
time.sleep(60)
"""
DEAF = """
import signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("ready", flush=True)
time.sleep(60)
"""


class Job(ProcessJob):
    """Keeps the events."""

    def note(self, event):
        self.events = [*getattr(self, "events", []), event["frame"]]


def until(condition, seconds=30.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def ended(job):
    until(lambda: job.ended)
    return job


def test_events_words_and_the_exit_code_of_a_process():
    job = ended(Job(SAYS, lambda _: ["0"]))
    assert job.events == [1, 2]
    assert (job.line, job.code, job.problem) == ("words", 0, "")
    assert ended(Job(SAYS, lambda _: ["2"])).problem == "words"


def test_a_process_that_is_told_to_end_writes_what_is_done():
    job = Job(WAITS, lambda _: [])
    until(lambda: job.line == "ready")
    job.stop()
    job.close()  # says it once
    assert (job.ended, job.code, job.line, job.problem) == (True, 130, "is written", "")


def test_a_process_that_does_not_end_is_killed(monkeypatch):
    monkeypatch.setattr(ProcessJob, "patience", 0.2)
    job = Job(DEAF, lambda _: [])
    until(lambda: job.line == "ready")
    job.close()
    assert job.ended and job.code < 0


def test_a_job_that_is_ended_before_it_begins_starts_no_process():
    job = Job(WAITS, lambda _: until(lambda: job.stopping) or [])
    job.close()
    assert job.ended and job.code is None and job._process is None and not job.problem


def test_the_folder_of_its_arguments_is_deleted():
    folders = []
    ended(Job(SAYS, lambda folder: folders.append(folder) or ["0"]))
    assert not folders[0].exists()


def test_what_prevents_a_job_is_a_sentence():
    def fails(_):
        raise OSError(28, "No space left on device")

    job = ended(Job(SAYS, fails))
    assert job.problem == "the work can't be done: No space left on device"


def test_a_process_that_talks_nonsense_ends(monkeypatch):
    job = ended(Job("import time; print('{\"event\" x', flush=True); time.sleep(60)", lambda _: []))
    assert "can't be done" in job.problem and job._process.returncode is not None


@pytest.mark.skipif(not hasattr(__import__("os"), "getpriority"), reason="no priorities there")
def test_it_has_a_lower_priority_and_a_session_of_its_own():
    code = """
import os, time
time.sleep(0.5)
print(os.getpriority(os.PRIO_PROCESS, 0), os.getsid(0) == os.getpid())
"""
    import os

    lower = min(os.getpriority(os.PRIO_PROCESS, 0) + 10, 19)
    assert ended(Job(code, lambda _: [])).line in (f"{lower} True", "10 True")
