"""What is printed never decides over work."""

import subprocess
import sys

import pytest

from deformrf.core.streams import Stream, printable

WORK = """
import sys
from deformrf.core.commands import asked_for_version, complain, run
from rich.progress import track
def job():
    for i in track(range(3)):
        print("a line", flush=True)
        print("a line", file=sys.stderr, flush=True)
    complain("x", "sentence")
    open(sys.argv[1], "w").write("done")
    print("the end")
    return 0
asked_for_version()
sys.exit(run("x", lambda: job))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="has no /dev/full")
@pytest.mark.parametrize("broken", [">/dev/full 2>&1", ">&- 2>&-", "2>&- | true", "2>/dev/full"])
def test_broken_streams_end_no_work(tmp_path, broken):
    done = tmp_path / "done"
    line = f'set -o pipefail; "$0" -c "$1" "$2" {broken}'
    code = subprocess.run(["bash", "-c", line, sys.executable, WORK, done]).returncode
    assert (code, done.read_text()) == (0, "done")


def test_the_first_failure_is_known():
    class Full:
        def write(self, text):
            raise OSError("full")

    stream = Stream(Full())
    assert stream.write("abc") == 3
    assert str(stream.failure) == "full"


def test_escape_codes_and_line_ends_are_shown_as_codes():
    assert printable("r\x1b[31m_0\n\udcff é.png") == r"r\x1b[31m_0\n\udcff é.png"
