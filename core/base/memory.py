"""How much main memory is free; a context manager that turns garbage collection off."""

import gc
from contextlib import contextmanager
from pathlib import Path


def free_bytes() -> int | None:
    """Bytes that this process can still take without swapping; None where nobody says."""
    found = []
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        found += [int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable")]
        group = Path("/sys/fs/cgroup")  # a container's limit
        limit, used = ((group / f"memory.{name}").read_text() for name in ("max", "current"))
        found += [] if limit.strip() == "max" else [max(0, int(limit) - int(used))]
    except (OSError, ValueError, LookupError):
        pass
    return min(found, default=None)


@contextmanager
def no_garbage_collected():
    """Context in which Python's collector of reference cycles does not run, in any thread."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
