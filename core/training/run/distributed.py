"""Several processes that learn one field, each with a GPU of its own.

torchrun starts them.  Each draws its share of a step's rays, their gradients are averaged in
one all-reduce, and all make the same update: so the weights stay the same everywhere.  What
decides how a run goes on has to be the same too; it is summed, or taken from the first worker.

A process by itself is a worker as well, ALONE, and exchanges nothing.
"""

import os
import signal
from contextlib import contextmanager
from datetime import timedelta

import torch
import torch.distributed as dist
import warp as wp

PATIENCE = timedelta(minutes=30)  # with a worker that does something by itself


class Workers:
    """All workers, as one of them sees them.

    Attributes:
        rank: This one's number.
        count: How many there are.
    """

    def __init__(self, rank=0, count=1, device="cpu"):
        self.rank, self.count = rank, count
        self._device = torch.device(device)
        self._interrupted = False

    @property
    def is_first(self) -> bool:
        """Whether this one speaks and writes for all."""
        return self.rank == 0

    def share(self, count: int) -> range:
        """Which of so many things are this worker's."""
        return range(self.rank * count // self.count, (self.rank + 1) * count // self.count)

    def sum_(self, tensor):
        """In place, over the workers."""
        if self.count > 1:
            dist.all_reduce(tensor)

    def max_(self, tensor):
        """In place, over the workers."""
        if self.count > 1:
            dist.all_reduce(tensor, dist.ReduceOp.MAX)

    def broadcast_(self, tensor):
        """Make it the first worker's, in place."""
        if self.count > 1:
            # Not every backend knows truth values.
            dist.broadcast(tensor.view(torch.uint8) if tensor.dtype == torch.bool else tensor, 0)

    def gather(self, mine, count: int):
        """All workers' parts of `count` values, in order; `mine` are those of `share(count)`."""
        if self.count == 1:
            return mine
        whole = mine.new_zeros(count)
        share = self.share(count)
        whole[share.start : share.stop] = mine
        self.sum_(whole)  # zeros elsewhere: exact
        return whole

    def total(self, number: int) -> int:
        """The sum of all workers' numbers; waits for them."""
        if self.count == 1:
            return number
        numbers = torch.tensor([number], device=self._device)
        self.sum_(numbers)
        return int(numbers)

    @contextmanager
    def stopping_together(self):
        """Context in which Ctrl-C waits for `stop_if_interrupted`, if there are several workers.

        One that stopped by itself would leave the others waiting for it.
        """
        if self.count == 1:
            yield
            return
        before = {s: signal.signal(s, self._note) for s in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _note(self, *_):
        self._interrupted = True

    def stop_if_interrupted(self):
        """Raise KeyboardInterrupt in all workers if any was interrupted."""
        if self.count > 1 and self.total(int(self._interrupted)):
            raise KeyboardInterrupt


ALONE = Workers()


@contextmanager
def torchrun_workers(device):
    """The Workers that torchrun has started, or ALONE without it.

    Args:
        device: This worker's, a Warp device.
    """
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
    yield Workers(dist.get_rank(), count, device)
    dist.destroy_process_group()  # not after an error, when nobody may answer


class SharedGradients:
    """Gradients of all workers' rays, and their error: weighted means, in one buffer.

    `collect`, `exchange`, `spread`: the first and the last can be recorded in CUDA graphs,
    because the buffer stays where it is.

    Args:
        parameters: Their gradients become views of the buffer.
        error: torch []
    """

    def __init__(self, workers: Workers, parameters, error):
        self.workers, self.parameters, self.error = workers, parameters, error
        sizes = [parameter.numel() for parameter in parameters]
        self.buffer = torch.zeros(sum(sizes) + 2, device=error.device)
        *parts, self._error, self._weight = self.buffer.split([*sizes, 1, 1])
        self._gradients = [
            part.view_as(parameter) for part, parameter in zip(parts, parameters, strict=True)
        ]

    @torch.no_grad()
    def collect(self, weight):
        """Take this worker's gradients and error, means over `weight` rays.  torch []"""
        for parameter, shared in zip(self.parameters, self._gradients, strict=True):
            torch.mul(parameter.grad, weight, out=shared)
            parameter.grad = shared
        self._error.copy_(self.error * weight)
        self._weight.copy_(weight)

    def exchange(self):
        """Sum over the workers."""
        self.workers.sum_(self.buffer)

    @torch.no_grad()
    def spread(self):
        """Make all gradients, and the error, the means over all workers' rays."""
        self.buffer[:-1] /= self._weight.clamp(min=1.0)
        self.error.copy_(self._error[0])
