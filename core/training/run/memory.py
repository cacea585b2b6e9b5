"""Halve the work if the GPU's memory is too small, or end the run with a sentence."""

from collections.abc import Callable

import torch

from .distributed import Workers

ADVICE = "shrink the images with --image-size, or take --preset tiny"


def lacks_memory(error: RuntimeError) -> bool:
    """Whether torch or Warp could not allocate."""
    return isinstance(error, torch.OutOfMemoryError) or "Failed to allocate" in str(error)


def halved(error: RuntimeError, size: int, least: int, what: str, workers: Workers) -> int:
    """Return half of `size`, or raise if it cannot be halved.

    Args:
        error: Why `size` was too much; anything but a lack of memory is raised again.
        size: Of something that is worked on at once, on all GPUs together.
        least: The smallest size that makes sense.
        what: The size's unit, for messages.

    Raises:
        MemoryError: A sentence: `least` is too much too.  Of several workers none can halve
            the size, because the others wait for it in the middle of something.
    """
    if not lacks_memory(error):
        raise error
    if workers.count > 1:
        raise MemoryError(
            f"the GPU of worker {workers.rank} has too little memory for its share of {size} "
            f"{what}: take more GPUs, {ADVICE} ({error})"
        ) from error
    if size // 2 < least:
        raise MemoryError(
            f"the GPU's memory is too small for {size} {what}: {ADVICE} ({error})"
        ) from error
    return size // 2


def within_memory(work: Callable, size: int, least: int, what: str, workers: Workers, device):
    """`work(size)`, with half the size as often as that is too much for the GPU's memory.

    Args:
        size, least, what, workers: See `halved`.
        device: A Warp device.
    """
    while True:
        try:
            return work(size)
        except RuntimeError as error:
            size = halved(error, size, least, what, workers)
        give_memory_back(device)


def give_memory_back(device):
    """Return what torch holds and doesn't use, so that Warp can have it.  A Warp device"""
    if device.is_cuda:
        torch.cuda.empty_cache()
