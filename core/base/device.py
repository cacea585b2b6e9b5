"""Choose the device and the number of threads, and start Warp without its messages.

A device has Warp's name, "cpu" or "cuda:0".  On command lines, "auto" means CUDA if the machine has
it.  torchrun starts one training process for each GPU.
"""

import ctypes
import os
import sys
import threading
import time
from functools import lru_cache
from math import ceil
from pathlib import Path
from typing import Literal

from . import kernel_cache

Choice = Literal["auto", "cpu", "cuda"]
_starting: threading.Thread | None = None
_started = False


def device_name(choice: Choice, for_training=False) -> str:
    """Start Warp and choose the device; for training, torch has to find it too.

    Raises:
        ValueError: CUDA is asked for and there is none, or not one for each process.
    """
    start_warp()
    import warp as wp

    available = choice != "cpu" and wp.is_cuda_available()
    if available and for_training:
        import torch

        available = torch.cuda.is_available()  # it may be a CPU build beside a good GPU
    if choice == "cuda" and not available:
        who = "torch" if for_training and wp.is_cuda_available() else "Warp"
        raise ValueError(f"{who} finds no CUDA device here; --device cpu works everywhere")
    if not available:
        return "cpu"
    index = int(os.environ.get("LOCAL_RANK", 0)) if for_training else 0
    if index > 0 and index >= (count := wp.get_cuda_device_count()):
        raise ValueError(f"torchrun's --nproc-per-node has to be at most {count}, the GPUs here")
    return f"cuda:{index}"


def thread_count() -> int:
    """The number of threads of this process that can run side by side.

    The process's CPU affinity counts, and the CPU quota of its container (cgroup v2 or v1).
    """
    affinity = getattr(os, "sched_getaffinity", None)  # Linux alone has it
    cores = len(affinity(0)) if affinity else os.cpu_count() or 1
    return max(1, ceil(min(cores, _container_cores(int(time.monotonic())))))


@lru_cache(maxsize=1)  # read once a second: rendering asks in every frame
def _container_cores(_second: int, root: Path = Path("/sys/fs/cgroup")) -> float:
    """The CPU quota of the container in cores; infinite without one."""
    try:
        if (limit := root / "cpu.max").exists():  # cgroup v2: "200000 100000" or "max 100000"
            quota, period = limit.read_text().split()
        else:
            quota, period = (
                (root / "cpu" / f"cpu.cfs_{name}_us").read_text() for name in ("quota", "period")
            )
        cores = float(quota) / float(period)
    except (OSError, ValueError, ZeroDivisionError):  # no cgroup, or "max"
        return float("inf")
    return cores if cores > 0.0 else float("inf")  # v1 says -1 for no limit


def begin_cuda() -> None:
    """Let CUDA start on the first GPU, if there is any, while this thread imports modules.

    It takes about half a second, and `start_warp` waits for its end.
    """
    global _starting
    if _starting is None and (driver := _cuda_driver()) is not None:
        # No daemon: a program that ends at once must not end in the middle of this.
        _starting = threading.Thread(target=_start_cuda, args=(driver,), name="start of CUDA")
        _starting.start()


def _start_cuda(driver):
    """Make the context that Warp and torch will use, too; they tell of what fails.

    It stays until the end of the process, even if Warp then refuses an old driver.
    """
    device, context = ctypes.c_int(), ctypes.c_void_p()
    if driver.cuInit(0) == 0 and driver.cuDeviceGet(ctypes.byref(device), 0) == 0:
        driver.cuDevicePrimaryCtxRetain(ctypes.byref(context), device)


def has_cuda_driver() -> bool:
    """Whether there may be a GPU for CUDA, which this does not start."""
    return _cuda_driver() is not None


def _cuda_driver():
    """NVIDIA's driver as a library; None where there is none."""
    try:
        return ctypes.CDLL("libcuda.so.1" if sys.platform != "win32" else "nvcuda.dll")
    except OSError:
        return None


def start_warp():
    """Initialize Warp without its greeting, and without a warning where there is no GPU.

    All that computes by Warp calls this first; only the first call has something to do.  Warp
    stays quiet, unless a program has chosen another level of its messages before, or does later.
    """
    global _started
    if _started:
        return
    import warp as wp

    if _starting is not None:
        _starting.join()
    if wp.config.log_level == wp.LOG_INFO:  # Warp's default
        wp.config.log_level = wp.LOG_ERROR
    kernel_cache.start(_init_silently if _cuda_driver() is None else wp.init)
    _started = True


def _init_silently():
    """Initialize Warp without what its C++ prints to file descriptor 2, whatever the log level."""
    import warp as wp

    sys.stderr.flush()
    kept, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null)
