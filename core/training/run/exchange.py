"""Exchange between the workers of a step: gradients before the update, weights after it.

The table holds nearly all weights, so each worker updates one part of it:

    reduce-scatter   the sum of all workers' table gradients, to each worker its own part
    all-reduce       the sums of all other gradients and errors, and the number of rays
    all-gather       the parts of the table after their update

All other weights are few; every worker makes the same update of all of them.

On CUDA a table gradient travels as bfloat16, which has the range of float32 and rounds a value
by at most 2⁻⁸ of it.  Each of N workers rounds its gradient, and the reduction rounds each of
its N − 1 sums.  So the error of a sum is at most about N · 2⁻⁸ · Σ |gradient|; where gradients
of opposite signs cancel, that is much of the sum.  The table travels as the float16 values that
the encoder reads in any case.  So the float32 table is whole on no worker until `make_whole`.
"""

import torch

from .training_field import TrainingField


class Exchange:
    """Gradients, errors and weights of several workers.

    `collect`, `spread` and `publish` can be recorded in CUDA graphs, `reduce` and `gather` not:
    to capture NCCL would couple every recording of one process to the others.

    Attributes:
        parameters: The parameters of this worker's optimizer, its part of the table first.

    Args:
        error: Mean squared error of the last step.  torch []
    """

    def __init__(self, field: TrainingField, error):
        self.field, self.error, self.workers = field, error, field.workers
        kind = torch.float32 if field.half_rows is None else torch.bfloat16
        self._table_gradient = torch.zeros_like(field.rows, dtype=kind)
        part = torch.nn.Parameter(self.workers.part_of(field.rows))  # the same memory
        self._part_gradient = torch.zeros_like(part, requires_grad=False)
        others = field.parameters()[1:]
        self.parameters = [part, *others]
        sizes = [parameter.numel() for parameter in others]
        self._sums = torch.zeros(sum(sizes) + 2, device=error.device)
        *gradients, self._error, self._weight = self._sums.split([*sizes, 1, 1])
        self._gradients = [g.view_as(p) for g, p in zip(gradients, others, strict=True)]

    @torch.no_grad()
    def collect(self, gradients, weight):
        """Take this worker's gradients and error.

        Args:
            gradients: Gradients of the field's parameters; means over the worker's rays that fit.
            weight: Number of those rays.  torch []
        """
        table, *others = gradients
        torch.mul(table, weight, out=self._table_gradient[: len(table)])
        for gradient, shared in zip(others, self._gradients, strict=True):
            torch.mul(gradient, weight, out=shared)
        self._error.copy_(self.error * weight)
        self._weight.copy_(weight)

    def reduce(self):
        """Sum over the workers."""
        self.workers.sum_parts_(self._table_gradient)
        self.workers.sum_(self._sums)

    @torch.no_grad()
    def spread(self):
        """Make the means over all workers' rays the gradients of `parameters`."""
        weight = self._weight.clamp(min=1.0)
        torch.div(self.workers.part_of(self._table_gradient), weight, out=self._part_gradient)
        self._sums[:-1] /= weight
        for parameter, gradient in zip(
            self.parameters, [self._part_gradient, *self._gradients], strict=True
        ):
            parameter.grad = gradient
        self.error.copy_(self._error[0])

    @torch.no_grad()
    def publish(self):
        """Convert this worker's part of the table to what the encoder reads."""
        if self.field.half_rows is not None:
            self.workers.part_of(self.field.half_rows).copy_(self.parameters[0])

    def gather(self):
        """Make the table that the encoder reads whole."""
        rows = self.field.rows if self.field.half_rows is None else self.field.half_rows
        self.workers.gather_parts_(rows)

    def make_whole(self):
        """Make the float32 table whole, for everything but the encoder."""
        self.workers.gather_parts_(self.field.rows)

    def whole(self, part):
        """The workers' parts of something with the table's rows; waits for them.  [n, F]"""
        rows = torch.zeros_like(self.field.rows)
        self.workers.part_of(rows).copy_(part)
        self.workers.gather_parts_(rows)
        return rows[: len(self.field.table)]

    def part(self, whole):
        """This worker's part of something with the table's rows."""
        rows = torch.zeros_like(self.field.rows)
        rows[: len(whole)] = whole
        return self.workers.part_of(rows).clone()
