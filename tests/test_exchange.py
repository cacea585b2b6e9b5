"""What workers exchange in half precision, as on CUDA: two of them in one process."""

import pytest
import torch

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.training.run import TrainingField, Workers
from deformrf.core.training.run.exchange import Exchange

WEIGHTS = (300.0, 100.0)  # rays of each worker


@pytest.fixture
def pair():
    """Two exchanges over fields of the same weights, whose tables have an odd number of rows."""
    exchanges = []
    for rank in range(2):
        options = FieldOptions(2, 2**8, march_step=0.05)
        field = TrainingField(a15_grid(0.25), options, "cpu", workers=Workers(rank, 2))
        field.half_rows = field.rows.half()
        exchanges.append(Exchange(field, torch.tensor(0.1 + rank)))
    return exchanges


def exchanged(pair):
    """Collect random gradients, sum what is sent, spread; each worker's gradients as they were."""
    generator = torch.Generator().manual_seed(5)
    own = [
        [torch.randn(p.shape, generator=generator) for p in one.field.parameters()] for one in pair
    ]
    for one, gradients, weight in zip(pair, own, WEIGHTS, strict=True):
        one.collect(gradients, torch.tensor(weight))
    for name in ("_table_gradient", "_sums"):
        total = sum(getattr(one, name) for one in pair)
        for one in pair:
            getattr(one, name).copy_(total)
    for one in pair:
        one.spread()
    return own


def test_gradients_are_weighted_means_of_all_workers(pair):
    own = exchanged(pair)
    share = WEIGHTS[0] / sum(WEIGHTS)
    table, *others = [share * a + (1.0 - share) * b for a, b in zip(*own, strict=True)]
    parts = torch.cat([one.parameters[0].grad for one in pair])[: len(table)]
    assert (parts - table).abs().max() < 3 * 2**-9 * max(g[0].abs().max() for g in own)
    for one in pair:
        for parameter, expected in zip(one.parameters[1:], others, strict=True):
            torch.testing.assert_close(parameter.grad, expected)
        assert one.error.item() == pytest.approx(0.1 + (1.0 - share))


def test_each_worker_updates_its_part_of_the_table(pair):
    exchanged(pair)
    before = pair[0].field.table.detach().clone()
    for one in pair:
        torch.optim.Adam(one.parameters, lr=1e-2).step()
        one.publish()
    count, half = len(before), len(pair[0].parameters[0])
    assert 2 * half >= count > half
    for one, mine, other in zip(
        pair, (slice(half), slice(half, count)), (slice(half, count), slice(half)), strict=True
    ):
        field = one.field
        assert not torch.equal(field.table[mine], before[mine])
        assert torch.equal(field.table[other], before[other])
        assert torch.equal(field.half_rows[:count][mine], field.table.detach()[mine].half())


@pytest.mark.parametrize("count", [2, 8])
def test_a_sum_of_bfloat16_gradients_is_as_exact_as_the_design_says(count):
    """At most N · 2⁻⁸ · Σ |gradient|, which is more than 2⁻⁹ of the sum."""
    gradients = torch.randn(count, 10_000, dtype=torch.float64)
    total = torch.zeros(10_000, dtype=torch.bfloat16)
    for gradient in gradients:
        total += gradient.bfloat16()
    error = (total.double() - gradients.sum(dim=0)).abs()
    assert (error <= count * 2**-8 * gradients.abs().sum(dim=0)).all()
    assert (error > 2**-9 * gradients.sum(dim=0).abs()).any()
