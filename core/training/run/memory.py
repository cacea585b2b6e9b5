"""If memory is too small, halve the work, or end the run with a sentence."""

from collections.abc import Callable

import torch

from .distributed import Workers

ADVICE = "shrink the images with --image-size, or take --preset tiny"
ALLOCATION_ERRORS = (RuntimeError, MemoryError)  # some of them; `lacks_memory` tells which
CPU_ALLOCATOR = "DefaultCPUAllocator"  # torch's, in its messages


class OutOfMemory(MemoryError):
    """Memory is too small; the message is a sentence for the user."""

    @classmethod
    def of(cls, error) -> "OutOfMemory":
        """The error itself if it is a sentence already, else one that quotes it."""
        if isinstance(error, cls):
            return error
        return cls(f"the {memory_name(error)} is too small: {ADVICE} ({error})")


def lacks_memory(error) -> bool:
    """Whether torch, Warp or numpy could not allocate, on a GPU or on the CPU."""
    if isinstance(error, torch.OutOfMemoryError | MemoryError):
        return True
    return "Failed to allocate" in str(error) or CPU_ALLOCATOR in str(error)


def memory_name(error) -> str:
    """The memory in which an allocation failed, in words."""
    said = str(error)
    on_cpu = isinstance(error, MemoryError) or CPU_ALLOCATOR in said or "on device 'cpu'" in said
    return "computer's memory" if on_cpu else "GPU's memory"


def halved(error, size: int, least: int, what: str, workers: Workers) -> int:
    """Return half of `size`, or raise if it cannot be halved.

    Args:
        error: Why `size` was too much; anything but a lack of memory is raised again.
        size, least: Items per pass, on all GPUs together, and the fewest that make sense.
        what: The size's unit, for messages.

    Raises:
        OutOfMemory: `least` is too much too.  Several workers can never halve the size, because
            the others wait for this one in the middle of a step.
    """
    if not lacks_memory(error) or isinstance(error, OutOfMemory):
        raise error
    if workers.count > 1:
        raise OutOfMemory(
            f"the {memory_name(error)} of worker {workers.rank} is too small for its share of "
            f"{size} {what}: take more GPUs, {ADVICE} ({error})"
        ) from error
    if size // 2 < least:
        raise OutOfMemory(
            f"the {memory_name(error)} is too small for {size} {what}: {ADVICE} ({error})"
        ) from error
    return size // 2


def within_memory(work: Callable, size: int, least: int, what: str, workers: Workers, device):
    """`work(size)`, with half the size as often as memory is too small; see `halved`."""
    while True:
        try:
            return work(size)
        except ALLOCATION_ERRORS as error:
            size = halved(error, size, least, what, workers)
        give_memory_back(device)


def give_memory_back(device):
    """Return what torch holds and doesn't use, so that Warp can have it.  A Warp device"""
    if device.is_cuda:
        torch.cuda.empty_cache()
