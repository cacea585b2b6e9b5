import subprocess
import sys

import pytest

from deformrf.core.base import device as devices
from deformrf.core.base.device import device_name, thread_count


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
    program = "from deformrf.core.base.device import device_name; device_name('auto')"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


@pytest.mark.parametrize("level", ["LOG_DEBUG", "LOG_WARNING"])
def test_a_program_chooses_what_warp_says(level):
    program = (
        "import warp as wp\n"
        "from deformrf.core.base.device import start_warp\n"
        "def chosen(level): wp.config.log_level = level; start_warp(); return wp.config.log_level\n"
        f"assert chosen(wp.{level}) == wp.{level}\n"
        "assert chosen(wp.LOG_INFO) == wp.LOG_INFO"  # after the start, it is nobody's default
    )
    subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)


@pytest.mark.parametrize(
    "files, cores",
    [
        ({"cpu.max": "150000 100000"}, 1.5),
        ({"cpu.max": "max 100000"}, float("inf")),
        ({"cpu/cpu.cfs_quota_us": "400000", "cpu/cpu.cfs_period_us": "100000"}, 4.0),
        ({"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, float("inf")),
        ({"cpu.max": "nonsense"}, float("inf")),
        ({}, float("inf")),
    ],
)
def test_a_containers_quota_is_read(tmp_path, files, cores):
    (tmp_path / "cpu").mkdir()
    for name, text in files.items():
        (tmp_path / name).write_text(text + "\n")
    assert devices._container_cores(0, tmp_path) == cores


def test_a_quota_is_read_once_a_second(tmp_path, monkeypatch):
    times = iter([10.2, 10.9, 11.0])
    monkeypatch.setattr("time.monotonic", lambda: next(times))
    monkeypatch.setattr("os.sched_getaffinity", lambda _: range(64), raising=False)
    unpatched = devices._container_cores
    monkeypatch.setattr(devices, "_container_cores", lambda second: unpatched(second, tmp_path))
    (tmp_path / "cpu.max").write_text("150000 100000\n")
    assert thread_count() == 2
    (tmp_path / "cpu.max").write_text("300000 100000\n")
    assert [thread_count() for _ in range(2)] == [2, 3]


def test_threads_keep_to_affinity_and_quota(monkeypatch):
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 3, 5}, raising=False)
    monkeypatch.setattr(devices, "_container_cores", lambda _second: float("inf"))
    assert thread_count() == 3
    monkeypatch.setattr(devices, "_container_cores", lambda _second: 1.5)
    assert thread_count() == 2
    monkeypatch.setattr(devices, "_container_cores", lambda _second: 0.2)
    assert thread_count() == 1
