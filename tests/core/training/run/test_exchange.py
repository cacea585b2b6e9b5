"""What workers exchange in half precision, as on CUDA: two of them in one process."""

import pytest
import torch

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.training.run.adam import BETAS, EPSILON, Adam
from deformrf.core.training.run.distributed import Workers
from deformrf.core.training.run.exchange import Exchange
from deformrf.core.training.run.peer_exchange import PeerExchange
from deformrf.core.training.run.training_field import TrainingField

WEIGHTS = (300.0, 100.0)  # rays of each worker
RATE = 1e-2


class OneProcess:
    """What PeerMemory does between two workers of one process."""

    def __init__(self, rank, shared):
        self.rank, self.shared, self.calls = rank, shared, 0

    def share(self, like):
        if self.calls == len(self.shared):
            self.shared.append([like.clone() for _ in WEIGHTS])
        self.calls += 1
        return self.shared[self.calls - 1]


@pytest.fixture(params=["collectives", "peers"])
def pair(request):
    """Two exchanges over fields of the same weights, whose tables have an odd number of rows."""
    exchanges, shared = [], []
    for rank in range(2):
        options = FieldOptions(2, 2**8, march_step=0.05)
        field = TrainingField(a15_grid(0.25), options, "cpu", workers=Workers(rank, 2))
        field.half_rows = field.rows.half()
        error = torch.tensor(0.1 + rank)
        if request.param == "peers":
            exchanges.append(PeerExchange(field, error, OneProcess(rank, shared)))
        else:
            exchanges.append(Exchange(field, error))
    return exchanges


def collected(pair, seed=5):
    """Collect random gradients, and sum what collectives would; each worker's gradients."""
    generator = torch.Generator().manual_seed(seed)
    own = [
        [torch.randn(p.shape, generator=generator) for p in one.field.parameters()] for one in pair
    ]
    for one, gradients, weight in zip(pair, own, WEIGHTS, strict=True):
        one.collect(gradients, torch.tensor(weight))
    if not isinstance(pair[0], PeerExchange):
        for name in ("_table_gradient", "_sums"):
            total = sum(getattr(one, name) for one in pair)
            for one in pair:
                getattr(one, name).copy_(total)
    return own


def weighted_mean(own):
    share = WEIGHTS[0] / sum(WEIGHTS)
    return [share * a + (1.0 - share) * b for a, b in zip(*own, strict=True)]


def optimizers(pair):
    return [Adam([{"params": one.parameters, "lr": RATE}]) for one in pair]


def test_gradients_are_weighted_means_of_all_workers(pair):
    _, *others = weighted_mean(collected(pair))
    for one, optimizer in zip(pair, optimizers(pair), strict=True):
        one.update(optimizer)
        for parameter, expected in zip(one.parameters[1:], others, strict=True):
            torch.testing.assert_close(parameter.grad, expected)
        assert one.error.item() == pytest.approx(0.1 + 1.0 - WEIGHTS[0] / sum(WEIGHTS))


def test_the_table_is_updated_as_by_adam_with_the_mean_gradient(pair):
    """Three updates; a gradient is off by its rounding to bfloat16, so its moments are, too."""
    reference = pair[0].field.table.detach().clone().requires_grad_()
    adam = torch.optim.Adam([reference], lr=RATE, betas=BETAS, eps=EPSILON)
    largest = 0.0
    ours = optimizers(pair)
    for seed in range(3):
        reference.grad = weighted_mean(own := collected(pair, seed))[0]
        largest = max(largest, *(gradients[0].abs().max().item() for gradients in own))
        adam.step()
        for one, optimizer in zip(pair, ours, strict=True):
            one.update(optimizer)
    rounding = 3 * 2**-9 * largest
    bounds = {"exp_avg": rounding, "exp_avg_sq": 2 * largest * rounding}
    for (name, bound), beta in zip(bounds.items(), BETAS, strict=True):
        states = [optimizer.state[one._share] for one, optimizer in zip(pair, ours, strict=True)]
        moments = torch.cat([state[name] for state in states])[: len(reference)]
        bound *= 1.0 - beta**3
        assert (moments - adam.state[reference][name]).abs().max() < bound < moments.max() / 10
    table = torch.cat([one._share.detach() for one in pair])[: len(reference)]
    assert ((table - reference).abs() < 0.05 * RATE).float().mean() > 0.98
    assert ours[0].state[pair[0]._share]["step"] == 3


def test_each_worker_updates_its_part_of_the_table(pair):
    collected(pair)
    before = pair[0].field.table.detach().clone()
    for one, optimizer in zip(pair, optimizers(pair), strict=True):
        one.update(optimizer)
    count, half = len(before), len(pair[0].parameters[0])
    assert 2 * half >= count > half
    for one, mine, other in zip(
        pair, (slice(half), slice(half, count)), (slice(half, count), slice(half)), strict=True
    ):
        field = one.field
        assert not torch.equal(field.table[mine], before[mine])
        assert torch.equal(field.table[other], before[other])
        assert torch.equal(field.half_rows[:count][mine], field.table.detach()[mine].half())


def test_peers_write_their_part_where_the_others_read_it(pair):
    if not isinstance(pair[0], PeerExchange):
        pytest.skip("collectives gather the parts")
    collected(pair)
    for one, optimizer in zip(pair, optimizers(pair), strict=True):
        one.update(optimizer)
    whole = torch.cat([one._share.detach() for one in pair]).half()
    for one in pair:
        assert torch.equal(one.field.half_rows, whole)


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
