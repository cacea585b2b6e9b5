"""The memory that the program holds, in main memory and on the device that renders."""

import os
import sys
from pathlib import Path

import warp as wp


def resident_bytes() -> int | None:
    """The program's bytes in main memory; their maximum without /proc, else None."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        pass
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def device_bytes(device) -> int | None:
    """Bytes of Warp's arrays on a CUDA device; None on the CPU.

    Without a memory pool it is what all programs have taken there.
    """
    if not device.is_cuda:
        return None
    if wp.is_mempool_enabled(device):
        return wp.get_mempool_used_mem_current(device)
    return device.total_memory - device.free_memory


def memory_line(device) -> str:
    """Both, in one line."""
    both = (("main memory", resident_bytes()), (device.name, device_bytes(device)))
    known = [f"{name} {count / 2**20:,.0f} MiB" for name, count in both if count is not None]
    return ", ".join(known) or "memory unknown"
