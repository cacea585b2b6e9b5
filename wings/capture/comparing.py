"""Where descriptors are compared: on the CPU by NumPy, or on a GPU by torch.

Both find the matches of nearest.py, in the same order.  Importing torch takes seconds, so a thread
does that while features are found.  Whatever fails on the GPU, as too little memory, is done by
the CPU.
"""

import logging
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np

from ...core.base.device import Choice, has_cuda_driver
from .nearest import FARTHEST, RATIO, matches_of, squares_of

PAIRS_AT_ONCE = 64  # in one product: of 512 features each, they take as much as one pair of 4,096
log = logging.getLogger(__name__)


class HostComparer:
    """Compares descriptors on the CPU."""

    def place(self, descriptors: np.ndarray):
        """Bring descriptors, [m, 128] uint8, to where they are compared."""
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

    def close(self):
        """Give back what comparing took."""


class TorchComparer:
    """The same on a GPU: a matrix product for each pair, or for many small ones together."""

    def __init__(self, device: str):
        """Any exception means that torch can't compute there."""
        import torch

        self._torch, self._device = torch, device
        # One thread: each would have a workspace of its own on the GPU, and distances in memory.
        self._thread = ThreadPoolExecutor(1)
        some = [torch.zeros((2, 128), dtype=torch.uint8, device=device)]
        self._thread.submit(self._counts, some, some).result()  # libraries are loaded now

    def place(self, descriptors: np.ndarray):
        placed = self._torch.from_numpy(np.array(descriptors))
        try:
            return placed.to(self._device)
        except RuntimeError:  # no room: it goes there for each product
            return placed

    def matches(self, one, other) -> np.ndarray:
        try:
            return self._thread.submit(self._matches, one, other).result()
        except RuntimeError:
            return HostComparer().matches(one.cpu().numpy(), other.cpu().numpy())

    def counts(self, ones, others, pool: Executor) -> list[int]:
        try:
            return self._thread.submit(self._counts, ones, others).result()
        except RuntimeError:
            sides = ([some.cpu().numpy() for some in side] for side in (ones, others))
            return HostComparer().counts(*sides, pool)

    def close(self):
        self._thread.shutdown()
        if self._device != "cpu":
            self._torch.cuda.empty_cache()  # Warp needs it, too

    def _matches(self, one, other):
        (j,) = self._partners([one], [other])
        (i,) = (j >= 0).nonzero(as_tuple=True)
        return self._torch.stack([i, j[i]], dim=1).cpu().numpy()

    def _counts(self, ones, others):
        firsts = range(0, len(ones), PAIRS_AT_ONCE)
        chunks = [slice(first, first + PAIRS_AT_ONCE) for first in firsts]
        found = [(self._partners(ones[c], others[c]) >= 0).sum(dim=1) for c in chunks]
        return self._torch.cat(found).tolist()

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
        """Descriptors of several photographs in one array, and which rows are padding.

        Returns:
            [P, m, 128] float32, [P, m] bool
        """
        torch, device = self._torch, self._device
        counts = torch.tensor([[len(some)] for some in descriptors], device=device)
        placed = [some.to(device) for some in descriptors]
        padded = torch.nn.utils.rnn.pad_sequence(placed, batch_first=True)
        return padded.float(), torch.arange(padded.shape[1], device=device) >= counts

    def _clearly_nearest(self, off):
        """The column of each row's clearly smallest distance, -1 without.  [P, m, k] -> [P, m]"""
        best, nearest = off.min(dim=2)
        second = off.scatter(2, nearest[:, :, None], self._torch.inf).amin(dim=2)
        clear = (best <= FARTHEST) & (RATIO[1] * best < RATIO[0] * second)
        return self._torch.where(clear, nearest, -1)


Comparer = HostComparer | TorchComparer


def begin_comparer(choice: Choice) -> Future[Comparer]:
    """Start a thread that loads the comparer for this machine.

    That is a GPU's if there is one, torch is installed with CUDA, and `choice` is not "cpu".
    """
    pool = ThreadPoolExecutor(1)
    future = pool.submit(HostComparer if choice == "cpu" or not has_cuda_driver() else loaded)
    pool.shutdown(wait=False)
    return future


def loaded(device: str = "cuda") -> Comparer:
    """The comparer on a GPU, or on the CPU if torch can't use that."""
    try:
        return TorchComparer(device)
    except Exception as error:  # a torch that is broken, or without CUDA; a GPU that is full
        log.info("Descriptors are compared on the CPU: %s", error)
        return HostComparer()
