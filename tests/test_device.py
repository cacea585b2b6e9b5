import subprocess
import sys

import pytest

from deformrf.core.device import device_name


def test_cpu_is_always_there():
    assert device_name("cpu") == device_name("cpu", for_training=True) == "cpu"


@pytest.mark.parametrize("available, device", [(True, "cuda:0"), (False, "cpu")])
def test_auto_is_cuda_where_there_is_any(monkeypatch, available, device):
    monkeypatch.setattr("warp.is_cuda_available", lambda: available)
    assert device_name("auto") == device


def test_each_process_of_torchrun_trains_on_a_gpu_of_its_own(monkeypatch):
    monkeypatch.setattr("warp.is_cuda_available", lambda: True)
    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    monkeypatch.setattr("warp.get_cuda_device_count", lambda: 2)
    monkeypatch.setenv("LOCAL_RANK", "1")
    assert device_name("auto", for_training=True) == "cuda:1"
    assert device_name("auto") == "cuda:0"
    monkeypatch.setenv("LOCAL_RANK", "2")
    with pytest.raises(ValueError, match="at most 2"):
        device_name("auto", for_training=True)


def test_training_needs_a_torch_that_finds_cuda_too(monkeypatch):
    monkeypatch.setattr("warp.is_cuda_available", lambda: True)
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    assert device_name("auto", for_training=True) == "cpu"
    with pytest.raises(ValueError, match="torch finds no CUDA device"):
        device_name("cuda", for_training=True)


def test_cuda_is_refused_where_there_is_none(monkeypatch):
    monkeypatch.setattr("warp.is_cuda_available", lambda: False)
    with pytest.raises(ValueError, match="Warp finds no CUDA device"):
        device_name("cuda")


def test_warp_starts_without_a_word():
    """Stderr is for one sentence about the user's mistake, stdout for results."""
    program = "from deformrf.core.device import device_name; device_name('auto')"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")
