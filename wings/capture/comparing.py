"""Where descriptors are compared: on the CPU by NumPy, or on a GPU by torch.

Both find the matches of nearest.py, in the same order.  Importing torch takes seconds, so a thread
does that while features are found.
"""

import threading
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np

from ...core.base.device import Choice, has_cuda_driver
from .nearest import FARTHEST, RATIO, matches_of

PAIRS_AT_ONCE = 64  # that are counted: of 512 features each, they take as much as one of 4,096


class HostComparer:
    """Compares descriptors on the CPU."""

    def place(self, descriptors: np.ndarray):
        """Descriptors, [m, 128] uint8, where they are compared."""
        return descriptors

    def matches(self, one, other) -> np.ndarray:
        """Matches of two photographs' descriptors, which `place` returned.

        Returns:
            The feature of the one and that of the other, by the one's.  [n, 2] int
        """
        return np.stack(matches_of(one.astype(np.float32), other.astype(np.float32)), axis=1)

    def counts(self, ones, others, pool: Executor) -> list[int]:
        """How many matches pairs of photographs have; descriptors as for `matches`.  [P]"""
        return list(map(len, pool.map(self.matches, ones, others)))


class TorchComparer:
    """The same on a GPU: a matrix product for each pair, or for many small ones together.

    Not more than some hundred megabytes are taken: other programs and the training need memory.
    """

    def __init__(self, device: str):
        import torch

        self._torch, self._device = torch, device
        self._lock = threading.Lock()  # distances of one call at a time are in memory

    def place(self, descriptors: np.ndarray):
        return self._torch.tensor(descriptors, device=self._device)

    def matches(self, one, other) -> np.ndarray:
        try:
            with self._lock, self._torch.inference_mode():
                (j,) = self._partners([one], [other])
                (i,) = (j >= 0).nonzero(as_tuple=True)
                return self._torch.stack([i, j[i]], dim=1).cpu().numpy()
        except self._torch.OutOfMemoryError:
            return HostComparer().matches(one.cpu().numpy(), other.cpu().numpy())

    def counts(self, ones, others, pool: Executor) -> list[int]:
        try:
            with self._lock, self._torch.inference_mode():
                firsts = range(0, len(ones), PAIRS_AT_ONCE)
                chunks = [slice(first, first + PAIRS_AT_ONCE) for first in firsts]
                found = [(self._partners(ones[c], others[c]) >= 0).sum(dim=1) for c in chunks]
                return self._torch.cat(found).tolist()
        except self._torch.OutOfMemoryError:
            sides = ([some.cpu().numpy() for some in side] for side in (ones, others))
            return HostComparer().counts(*sides, pool)

    def _partners(self, ones, others):
        """The match of each feature of the one of each pair, -1 without one.  [P, m] int"""
        torch = self._torch
        (one, rows), (other, columns) = self._padded(ones), self._padded(others)
        # TensorFloat-32 has room for components of up to 255, so it is as exact.
        off = torch.baddbmm(squares_of(one)[:, :, None], one, other.mT, alpha=-2.0)
        off += squares_of(other)[:, None]
        off.masked_fill_(rows[:, :, None] | columns[:, None], torch.inf)
        if not off.numel():
            return off.new_full(rows.shape, -1, dtype=torch.long)
        j, i = self._clearly_nearest(off), self._clearly_nearest(off.mT)
        back = i.gather(1, j.clamp(min=0))
        return torch.where(back == torch.arange(j.shape[1], device=j.device), j, -1)

    def _padded(self, descriptors):
        """Descriptors of several photographs in one array, and which rows are none's.

        Returns:
            [P, m, 128] float32, [P, m] bool
        """
        torch = self._torch
        counts = torch.tensor([[len(some)] for some in descriptors], device=self._device)
        padded = torch.nn.utils.rnn.pad_sequence(descriptors, batch_first=True)
        return padded.float(), torch.arange(padded.shape[1], device=self._device) >= counts

    def _clearly_nearest(self, off):
        """The column of each row's clearly smallest distance, -1 without.  [P, m, k] -> [P, m]"""
        best, nearest = off.min(dim=2)
        second = off.scatter(2, nearest[:, :, None], self._torch.inf).amin(dim=2)
        clear = (best <= FARTHEST) & (RATIO[1] * best < RATIO[0] * second)
        return self._torch.where(clear, nearest, -1)


def squares_of(descriptors):
    """Their squared lengths.  [..., 128] -> [...]"""
    return (descriptors * descriptors).sum(dim=-1)


def begin_comparer(choice: Choice) -> Future:
    """Load what compares descriptors fastest, in a thread; a Future of the comparer.

    That is a GPU's if there is one, torch is installed with CUDA, and `choice` is not "cpu".
    """
    pool = ThreadPoolExecutor(1)
    future = pool.submit(HostComparer if choice == "cpu" or not has_cuda_driver() else loaded)
    pool.shutdown(wait=False)
    return future


def loaded() -> HostComparer | TorchComparer:
    """The comparer of this machine, once torch is imported."""
    try:
        import torch
    except ImportError:
        return HostComparer()
    if not torch.cuda.is_available():
        return HostComparer()
    torch.zeros(1, device="cuda")  # it starts CUDA
    return TorchComparer("cuda")
