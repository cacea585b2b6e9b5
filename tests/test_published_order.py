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
