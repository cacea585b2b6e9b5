"""The benchmarks' published order: the supplement's matrices, in kernels and reference alike."""

import subprocess
import sys
from pathlib import Path

import pytest

RUNNER = Path(__file__).parent / "benchmarks" / "published_order.py"

MATRICES = """
import numpy as np
from deformrf.core.geometry import subdivision

published = np.array([
    [[1, -1, -1, -1], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 2]],
    [[-1, 1, -1, -1], [0, 0, 2, 0], [2, 0, 0, 0], [0, 0, 0, 2]],
    [[-1, -1, 1, -1], [2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 0, 2]],
    [[-1, -1, -1, 1], [2, 0, 0, 0], [0, 0, 2, 0], [0, 2, 0, 0]],
    [[1, 1, -1, -1], [0, 0, 2, 0], [1, -1, -1, 1], [-1, 1, 1, 1]],
    [[1, 1, -1, -1], [1, -1, 1, 1], [0, 0, 0, 2], [-1, 1, 1, -1]],
    [[-1, -1, 1, 1], [1, 1, 1, -1], [0, 2, 0, 0], [1, -1, -1, 1]],
    [[-1, -1, 1, 1], [2, 0, 0, 0], [-1, 1, 1, -1], [1, 1, -1, 1]],
])
np.testing.assert_allclose(subdivision.CHILD_FROM_PARENT, published, atol=1e-12)
"""

SUITE = """
import sys
import pytest
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", "-m", "not gpu", *sys.argv[1:]]))
"""


@pytest.fixture
def run(tmp_path):
    """Run a program's text in a process that has the published order."""

    def run(text, *arguments):
        script = tmp_path / "script.py"
        script.write_text(text)
        command = [sys.executable, str(RUNNER), str(script), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, cwd=RUNNER.parents[2])

    return run


def test_the_matrices_are_the_supplements(run):
    result = run(MATRICES)
    assert result.returncode == 0, result.stderr


def test_kernels_and_references_have_the_same_order(run):
    """What holds for any order is tested there again; only what Bey's order gives is lost."""
    tests = Path(__file__).parent
    names = ("test_subdivision.py", "test_encoding.py", "test_occupancy.py", "test_reach.py")
    result = run(SUITE, *(tests / name for name in names))
    failed = [line for line in result.stdout.splitlines() if line.startswith("FAILED")]
    assert [line.split("::")[1].split()[0] for line in failed] == [
        "test_descendants_fall_into_three_shapes_at_most",
        "test_the_lattice_knows_the_descendants_corners[cpu-4]",
    ], result.stdout
