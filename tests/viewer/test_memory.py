"""The memory that the statistics show."""

import subprocess
import sys

import pytest
import warp as wp

from deformrf.viewer import memory


def test_an_array_shows_in_main_memory():
    """In a process of its own: what other tests have taken and freed may be taken again."""
    program = (
        "import numpy as np; from deformrf.viewer.memory import resident_bytes as now;"
        "before = now(); array = np.ones(100 * 2**20, np.uint8); print(now() - before)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert 50 * 2**20 < int(done.stdout) < 400 * 2**20, done.stderr


def test_without_proc_there_is_the_maximum(monkeypatch):
    pytest.importorskip("resource")

    def absent(path):
        raise FileNotFoundError(path)

    now = memory.resident_bytes()
    monkeypatch.setattr(memory.Path, "read_text", absent)
    assert 0.5 * now < memory.resident_bytes() < 2**40


def test_the_line_names_the_device_if_it_has_memory_of_its_own(device):
    wp.init()
    line = memory.memory_line(wp.get_device(device))
    assert line.startswith("main memory ") and "MiB" in line
    assert (wp.get_device(device).name in line) == (device != "cpu")


@pytest.mark.gpu
def test_an_array_shows_on_the_device():
    device = wp.get_device("cuda:0")
    before = memory.device_bytes(device)
    array = wp.zeros(64 * 2**20, dtype=float, device=device)
    wp.synchronize_device(device)
    assert memory.device_bytes(device) - before >= 200 * 2**20
    assert len(array)
