"""Several processes that train one field, each with a GPU of its own.

torchrun starts them.  Each draws its share of a step's rays.  After each step, the weights with
which they render are equal (exchange.py, peer_exchange.py).  Numbers that control the run must also
be the same: they are summed over the workers, or taken from the first one.

A single process is the worker ALONE, and exchanges nothing.
"""

import os
import signal
from contextlib import contextmanager
from datetime import timedelta

import torch
import torch.distributed as dist
import warp as wp

# PyTorch 2.13 gave them other names.
all_gather = getattr(dist, "all_gather_single", None) or dist.all_gather_into_tensor
reduce_scatter = getattr(dist, "reduce_scatter_single", None) or dist.reduce_scatter_tensor
PATIENCE = timedelta(minutes=30)  # with a worker that works alone, as when it evaluates


class Workers:
    """All `count` workers, as the one with index `rank` sees them."""

    def __init__(self, rank=0, count=1, device="cpu"):
        self.rank, self.count = rank, count
        self._device = torch.device(device)
        self._interrupted = False  # this worker
        self._all_stop = False  # any worker, when last heard of
        self._is_alone = False  # nobody waits for this worker

    @property
    def is_first(self) -> bool:
        """Whether this worker prints and writes files for all."""
        return self.rank == 0

    def share(self, count: int) -> range:
        """This worker's range of `count` things."""
        return range(self.rank * count // self.count, (self.rank + 1) * count // self.count)

    def sum_(self, tensor):
        """In place, over the workers."""
        if self.count > 1:
            dist.all_reduce(tensor)

    def max_(self, tensor):
        """In place, over the workers."""
        if self.count > 1:
            dist.all_reduce(tensor, dist.ReduceOp.MAX)

    def padded(self, count: int) -> int:
        """The next number of rows that can be cut into equal shares, one for each worker."""
        return -(-count // self.count) * self.count

    def share_of(self, rows):
        """This worker's share of that many rows: a view."""
        size = len(rows) // self.count
        return rows[self.rank * size : (self.rank + 1) * size]

    def sum_shares_(self, rows):
        """Sum over the workers, in place, each its own share; the other shares are undefined."""
        reduce_scatter(self.share_of(rows), rows)

    def gather_shares_(self, rows):
        """Fill in the other workers' shares, in place."""
        all_gather(rows, self.share_of(rows))

    def broadcast_(self, tensor):
        """Make it the first worker's, in place."""
        if self.count > 1:
            # Not every backend can send bool.
            dist.broadcast(tensor.view(torch.uint8) if tensor.dtype == torch.bool else tensor, 0)

    def gather(self, mine, count: int):
        """All workers' shares of `count` values, in order; `mine` are those of `share(count)`."""
        if self.count == 1:
            return mine
        whole = mine.new_zeros(count)
        share = self.share(count)
        whole[share.start : share.stop] = mine
        self.sum_(whole)  # zeros elsewhere: exact
        return whole

    def total(self, number: int) -> int:
        """The sum of all workers' numbers; waits for them, and hears of interrupts."""
        if self.count == 1:
            return number
        numbers = torch.tensor([number, self._interrupted], device=self._device)
        self.sum_(numbers)
        total, interrupts = numbers.tolist()
        self._all_stop = interrupts > 0
        return total

    def any(self, mine: bool) -> bool:
        """Whether `mine` is true for any worker; waits for all of them."""
        return self.total(int(mine)) > 0

    @contextmanager
    def stopping_together(self):
        """Context in which Ctrl-C waits for `stop_if_interrupted`, if there are several workers.

        So do SIGTERM and SIGHUP, which comes to all of a terminal's processes.  A worker that
        stopped alone would leave the others waiting for it.
        """
        if self.count == 1:
            yield
            return
        self._interrupted = self._all_stop = False
        numbers = [getattr(signal, name, signal.SIGINT) for name in ("SIGINT", "SIGTERM", "SIGHUP")]
        before = {n: signal.getsignal(n) for n in numbers if signal.getsignal(n) != signal.SIG_IGN}
        for number in before:
            signal.signal(number, self._note)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    @contextmanager
    def working_alone(self):
        """Context in `stopping_together` in which no worker waits for this one: Ctrl-C ends it.

        Only once: torchrun sends its workers a signal of its own, which must not end what follows.
        """
        if self._interrupted:  # since the workers last heard of one another
            raise KeyboardInterrupt
        self._is_alone = True
        try:
            yield
        finally:
            self._is_alone = False

    def _note(self, *_):
        self._interrupted = True
        if self._is_alone:
            self._is_alone = False
            raise KeyboardInterrupt

    def stop_if_interrupted(self):
        """Raise KeyboardInterrupt in all workers if any was interrupted before the last `total`."""
        if self._all_stop:
            raise KeyboardInterrupt


ALONE = Workers()
_was_worker = False  # this process


def was_worker() -> bool:
    """Whether torchrun_workers has made this process one of several workers."""
    return _was_worker


@contextmanager
def torchrun_workers(device):
    """The Workers that torchrun has started, or ALONE; `device` is this worker's."""
    global _was_worker
    count = int(os.environ.get("WORLD_SIZE", 1))
    if count == 1:
        yield ALONE
        return
    device = torch.device(wp.device_to_torch(wp.get_device(device)))
    if device.type == "cuda":
        torch.cuda.set_device(device)  # so that nothing lands on another worker's GPU
        wp.set_device(wp.device_from_torch(device))
        dist.init_process_group("nccl", timeout=PATIENCE, device_id=device)
    else:
        dist.init_process_group("gloo", timeout=PATIENCE)
    _was_worker = True
    yield Workers(dist.get_rank(), count, device)
    dist.destroy_process_group()  # not after an error, when nobody may answer
