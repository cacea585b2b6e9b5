"""deformrf doctor names what a report of a problem should begin with."""

import subprocess
import sys

import pytest

PROGRAM = "import sys; from deformrf.commands.entry import main; sys.exit(main())"


@pytest.mark.gl
def test_the_doctor_names_what_it_found(window):
    command = [sys.executable, "-c", PROGRAM, "--device", "cuda", "doctor", "--headless"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    for word in ("deformrf", "warp-lang", "CUDA", "OpenGL", "interop", "H.264", "preferences"):
        assert f"{word}" in done.stdout
