"""Two processes that want to write one file: the second is told, whatever became of the first."""

import os
import subprocess
import sys

import pytest

from deformrf.core.base.claims import claim, release

pytestmark = pytest.mark.skipif(os.name != "posix", reason="locks of POSIX")
HOLDER = """
import sys
from pathlib import Path
from deformrf.core.base.claims import claim
claim(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def holder():
    """Starts a process that claims a path."""
    started = []

    def start(path):
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        started.append(subprocess.Popen([sys.executable, "-c", HOLDER, path], **pipes))
        assert started[-1].stdout.readline() == b"held\n"
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()
    release()


def test_a_file_is_one_process_s_until_that_ends(tmp_path, holder):
    path, link = tmp_path / "model.npz", tmp_path / "link.npz"
    link.symlink_to(path)
    process = holder(path)
    for name in (path, link, tmp_path / "." / "model.npz"):
        with pytest.raises(ValueError, match=r"\.npz is being written by another process"):
            claim(name)
    claim(tmp_path / "other.npz")
    assert not list(tmp_path.glob("*.lock")) and not path.exists()
    process.kill()
    process.wait()
    claim(path)
    claim(path)  # again, by the same process


def test_what_was_claimed_is_free_after_the_work(tmp_path, holder):
    claim(tmp_path / "a.npz")
    release()
    holder(tmp_path / "a.npz")


def test_without_a_folder_for_it_nothing_is_claimed(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    for state in ("~", tmp_path / "file"):
        monkeypatch.setattr("platformdirs.user_state_path", lambda name, s=state: type(tmp_path)(s))
        monkeypatch.chdir(tmp_path)
        claim(tmp_path / "a.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
