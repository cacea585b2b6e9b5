"""Native code for processors with vectors of 8 lanes, and without products of bfloat16."""

import platform
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import sys
import pytest
import warp as wp
wp.config.cpu_compiler_flags = "-target-cpu haswell"
sys.exit(pytest.main(["-qrs", "-p", "no:cacheprovider", "-p", "no:xdist", *sys.argv[1:]]))
"""
FILES = [
    Path(__file__).parents[1] / "core" / name
    for name in (
        "render/rays/test_raster.py",
        "render/rounds/test_cpu.py",
        "render/rays/test_cpu_march.py",
    )
]


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="needs an x86-64")
def test_its_tests_pass_as_for_a_haswell():
    """It knows AVX2 and FMA, as every x86-64 of the last ten years, and no AVX-512."""
    command = [sys.executable, "-c", PROGRAM, *FILES]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout[-3000:] + ended.stderr[-1000:]
    assert "does not multiply pairs" in ended.stdout
