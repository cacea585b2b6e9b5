"""What is printed never decides over work."""

import os
import subprocess
import sys
from itertools import combinations

import pytest
from PIL import Image

from deformrf.core.base.streams import Stream, printable, shown
from deformrf.core.field import load

WORK = """
import sys
from deformrf.commands.running import complain, run
from deformrf.core.base.streams import keep_going
from rich.progress import track
def job():
    for i in track(range(3)):
        print("a line", flush=True)
        print("a line", file=sys.stderr, flush=True)
    complain("x", "sentence")
    open(sys.argv[1], "w").write("done")
    print("the end")
    return 0
keep_going()
sys.exit(run("x", lambda: job))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="has no /dev/full")
@pytest.mark.parametrize("broken", [">/dev/full 2>&1", ">&- 2>&-", "2>&- | true", "2>/dev/full"])
def test_broken_streams_end_no_work(tmp_path, broken):
    done = tmp_path / "done"
    line = f'set -o pipefail; "$0" -c "$1" "$2" {broken}'
    code = subprocess.run(["bash", "-c", line, sys.executable, WORK, done]).returncode
    assert (code, done.read_text()) == (0, "done")


NUMBERS = """
import os, sys
from deformrf.core.base.streams import keep_going
keep_going()
with open(sys.argv[1], "w") as file:
    assert file.fileno() > 2, file.fileno()
    os.write(1, b"a warning")  # as libraries do, whatever is open there
    os.write(2, b"a warning")
    os.close(os.dup(2))
    print(sys.stdin.read(), sys.stdin.fileno(), sys.stdout.fileno(), sys.stderr.fileno())
    sub = "import os; [os.fstat(number) for number in range(3)]"
    import subprocess
    file.write("done" if not subprocess.call([sys.executable, "-c", sub]) else "a child has less")
"""
CLOSED = [" ".join(c) for n in range(4) for c in combinations(("<&-", ">&-", "2>&-"), n)]


@pytest.mark.skipif(sys.platform == "win32", reason="no such shell")
@pytest.mark.parametrize("closed", CLOSED)
def test_no_file_gets_the_number_of_a_stream_that_was_closed(tmp_path, closed):
    done = tmp_path / "done"
    command = ["bash", "-c", f'"$0" -c "$1" "$2" {closed}', sys.executable, NUMBERS, done]
    code = subprocess.run(command, stdin=subprocess.DEVNULL).returncode
    assert (code, done.read_text()) == (0, "done")


@pytest.mark.skipif(sys.platform == "win32", reason="no such shell")
@pytest.mark.parametrize("closed", CLOSED[-1:])
def test_training_needs_no_stream(tmp_path, write_dataset, closed):
    """It has Warp print nowhere meanwhile, which takes number 2."""
    image = Image.new("RGBA", (24, 24), (200, 40, 30, 255))
    for split in ("train", "test"):
        write_dataset(tmp_path / "data", [image] * 3, split)
    program = "from deformrf.commands.entry import train; import sys; sys.exit(train())"
    flags = "--preset tiny --steps 2 --spacing 0.2 --leave-out coarse-stage --scene-radius 1.3"
    line = f'"$0" -c "$1" "$2" -o "$3" {flags} --device cpu {closed}'
    model = tmp_path / "m.npz"
    command = ["bash", "-c", line, sys.executable, program, tmp_path / "data", model]
    state = {**os.environ, "XDG_STATE_HOME": str(tmp_path / "state")}
    assert subprocess.run(command, env=state).returncode == 0
    assert load(model).meta["history"] and not [*tmp_path.rglob("crash-*")]


def test_the_first_failure_is_known():
    class Full:
        def write(self, text):
            raise OSError("full")

    stream = Stream(Full())
    assert stream.write("abc") == 3
    assert str(stream.failure) == "full"


def test_escape_codes_and_line_ends_are_shown_as_codes():
    assert printable("r\x1b[31m_0\n\udcff é.png") == r"r\x1b[31m_0\n\udcff é.png"


@pytest.mark.parametrize(
    "value, words",
    [
        ("a bone", "'a bone'"),
        (5, "5"),
        ([1, "x"], "[1, 'x']"),
        ({"a": None}, "{'a': None}"),
    ],
)
def test_a_value_of_a_file_is_quoted(value, words):
    assert shown(value) == words
    assert shown(10**5000) == "one int that is too long to print"


def test_a_quoted_value_is_short_whatever_it_holds():
    doubled = ()
    for _ in range(60):
        doubled = (doubled, [doubled])
    for value in (doubled, "x" * 10**6, ["y" * 10**6] * 10**6, dict.fromkeys(range(999), "z" * 99)):
        assert 10 < len(shown(value)) <= 100
