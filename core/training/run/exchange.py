"""Exchange between the workers of a step: gradients before the update, weights after it.

The table contains nearly all weights, so each worker updates one share of it:

    reduce-scatter   sums all workers' table gradients; each worker receives its own share
    all-reduce       sums all workers' other gradients, squared errors and numbers of pixels
    all-gather       collects the updated shares of the table

Every worker makes the same update of all other weights.

On CUDA a table gradient is sent as bfloat16, which has the range of float32 and rounds a value
by at most 2⁻⁸ of it.  Each of N workers rounds its gradient, and the reduce-scatter rounds each
of its N − 1 sums (peers' sums are float32, see peer_exchange.py).  So the error of a sum is at
most about N · 2⁻⁸ · Σ |gradient|; where gradients of opposite signs cancel, that is much of the
sum.  The table is sent as float16, because the encoder reads float16 in any case.  So no worker has
the whole float32 table until `make_whole`.
"""

from collections.abc import Callable

import torch

from .training_field import TrainingField


class Exchange:
    """Gradients, errors and weights of several workers, exchanged by collectives.

    To capture NCCL in a CUDA graph would couple every recording of one process to the others.

    Attributes:
        parameters: The parameters of this worker's optimizer, its share of the table first.

    Args:
        error: Mean squared error of the last step.  torch []
    """

    def __init__(self, field: TrainingField, error):
        self.field, self.error, self.workers = field, error, field.workers
        kind = torch.float32 if field.half_rows is None else torch.bfloat16
        self._table_gradient = torch.zeros_like(field.rows, dtype=kind)
        self._share = torch.nn.Parameter(self.workers.share_of(field.rows))  # the same memory
        self._share_gradient = torch.zeros_like(self._share, requires_grad=False)
        self._others = field.parameters()[1:]
        self._side_stream = torch.cuda.Stream(error.device) if error.is_cuda else None
        self.parameters = [self._share, *self._others]
        # All other gradients, the error and the weight: this worker's, and of all workers.
        size = sum(parameter.numel() for parameter in self._others) + 2
        self._mine = self._sums = torch.zeros(size, device=error.device)

    def _split(self, sums):
        """What `_mine` or `_sums` holds: gradients, error, weight."""
        sizes = [parameter.numel() for parameter in self._others]
        *gradients, error, weight = sums.split([*sizes, 1, 1])
        shaped = [g.view_as(p) for g, p in zip(gradients, self._others, strict=True)]
        return shaped, error, weight

    def side_by_side(self, small: Callable[[], None], large: Callable[[], None]):
        """Call both; on CUDA what `small` launches, by torch alone, runs beside the other."""
        stream, main = self._side_stream, torch.cuda.current_stream
        if stream is None:
            small()
            large()
            return
        stream.wait_stream(main())
        with torch.cuda.stream(stream):
            small()
        large()
        main().wait_stream(stream)

    @torch.no_grad()
    def collect(self, gradients, weight):
        """Take this worker's gradients and error; CUDA graphs can hold it.

        Args:
            gradients: Gradients of the field's parameters; means over the pixels that the worker
                tried, see Drawn.tries.
            weight: Number of those pixels.  torch []
        """
        table, *others = gradients
        shared, error, shared_weight = self._split(self._mine)

        def collect_others():
            torch._foreach_copy_(shared, torch._foreach_mul(others, weight))
            error.copy_(self.error * weight)
            shared_weight.copy_(weight)

        def collect_table():
            torch.mul(table, weight, out=self._table_gradient[: len(table)])

        self.side_by_side(collect_others, collect_table)

    def tasks(self, optimizer) -> dict:
        """The tasks of an update after `collect`: name -> (function, whether a graph holds it)."""
        return {
            "reduce": (self.reduce, False),
            "update": (lambda: self.update(optimizer), True),
            "gather": (self.gather, False),
        }

    def reduce(self):
        """Sum over the workers."""
        self.workers.sum_shares_(self._table_gradient)
        self.workers.sum_(self._sums)

    @torch.no_grad()
    def update(self, optimizer):
        """Update this worker's share of the table, and all other weights."""
        weight = self._split(self._sums)[2].clamp_(min=1.0)
        self._sums[:-1] /= weight  # means over all workers' pixels
        self._hand_out()
        torch.div(self.workers.share_of(self._table_gradient), weight, out=self._share_gradient)
        self._share.grad = self._share_gradient
        optimizer.step()
        if self.field.half_rows is not None:
            self.workers.share_of(self.field.half_rows).copy_(self._share)

    def _hand_out(self):
        """Give the means in `_sums` to the parameters and the error."""
        gradients, error, _ = self._split(self._sums)
        for parameter, gradient in zip(self._others, gradients, strict=True):
            parameter.grad = gradient
        self.error.copy_(error[0])

    def gather(self):
        """Make the table that the encoder reads whole."""
        rows = self.field.rows if self.field.half_rows is None else self.field.half_rows
        self.workers.gather_shares_(rows)

    def make_whole(self):
        """Make the float32 table whole, for everything but the encoder; waits for all workers."""
        self.workers.gather_shares_(self.field.rows)

    def whole(self, share):
        """The workers' shares of something with the table's rows; waits for them.  [n, F]"""
        rows = torch.zeros_like(self.field.rows)
        self.workers.share_of(rows).copy_(share)
        self.workers.gather_shares_(rows)
        return rows[: len(self.field.table)]

    def share(self, whole):
        """This worker's share of something with the table's rows."""
        rows = torch.zeros_like(self.field.rows)
        rows[: len(whole)] = whole
        return self.workers.share_of(rows).clone()
