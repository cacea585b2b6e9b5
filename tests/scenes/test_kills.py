"""The program that cuts others off finds those that leave half a file, and no others."""

import multiprocessing
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from deformrf.core.base.paths import ROOT, whole_file

sys.path.append(str(ROOT / "tests" / "benchmarks"))
from killing.kinds import Fault, OneFile
from killing.process import Job, Moment

LINES = 20


def write(path):
    with open(path, "w") as file:
        for _ in range(LINES):
            file.write("line\n")
            file.flush()
            time.sleep(0.005)


def write_whole(path):
    with whole_file(path) as partial:
        write(partial)


def write_elsewhere(path):
    write_whole(path)
    Path(path).with_name("stray.txt").touch()


class File(OneFile):
    """A text, written by `call`."""

    name, call = "file.txt", staticmethod(write_whole)

    def job(self):
        return Job((self.path,), self.call)

    def is_whole(self):
        if len(self.path.read_text().splitlines()) != LINES:
            raise Fault("half a file")


class Half(File):
    call = staticmethod(write)


class Stray(File):
    call = staticmethod(write_elsewhere)


@pytest.fixture
def tried(tmp_path):
    """A function that returns the results of a kind's trials, and the trials."""

    def trials(kind, count=9):
        done = kind(multiprocessing.get_context("forkserver"), tmp_path, np.random.default_rng(3))
        return list(done.trials(count)), done

    return trials


@pytest.mark.parametrize(
    ("kind", "said"), [(Half, "half a file"), (Stray, "a file stray.txt is left")]
)
def test_what_leaves_half_a_file_or_another_one_is_found(tried, kind, said):
    assert any(said in result for result in tried(kind)[0])


def test_whole_files_are_no_fault_and_the_moments_cover_the_run(tried):
    results, trials = tried(File, 12)
    assert {*results} <= {"old", "new", "absent"} and len({*results}) > 1
    events = " ".join(told["event"] for told in trials.told)
    assert "before os.rename" in events and "after begun" in events
    assert {told["code"] for told in trials.told} <= {0, -signal.SIGKILL}


def test_a_process_sends_itself_the_signal_at_an_event(tried):
    """Before a file is renamed, however slow the machine is."""
    _, trials = tried(File, 0)
    names = [what for _, what in trials.measured.events]
    renamed = next(i for i, what in enumerate(names) if what.startswith("os.rename"))
    trials.lay(0)
    ended = trials.run(Moment(renamed, 0.0))
    assert ended.code == -signal.SIGKILL and len(ended.events) == renamed + 1
    assert not trials.path.exists() or trials.before is not None
