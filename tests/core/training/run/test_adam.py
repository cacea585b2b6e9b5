"""Our Adam against torch's: the same weights, the same state, none of torch's compiler.

Its rates: a cosine to a stage's final rate, and wide color networks that learn slower.
"""

import copy
import subprocess
import sys

import numpy as np
import pytest
import torch
from gray_photographs import gray_photographs

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.training import preset, stages, world_to_unit_cube
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run.adam import BETAS, EPSILON, Adam, learning_rate
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.training_field import TrainingField

RATES = 0.01, 0.03


def parameters(rng, device):
    values = [rng.normal(size=shape).astype(np.float32) for shape in ((5, 3), (7,), ())]
    return [torch.tensor(value, device=device, requires_grad=True) for value in values]


def groups_of(some):
    return [{"params": some[:2], "lr": RATES[0]}, {"params": some[2:], "lr": RATES[1]}]


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def give_gradients(rng, *many):
    for same in zip(*many, strict=True):
        gradient = rng.normal(size=same[0].shape)
        for parameter in same:
            parameter.grad = torch.tensor(gradient, dtype=torch.float32, device=parameter.device)


def test_it_updates_as_torch_does(rng, device):
    ours = parameters(rng, device)
    theirs = [p.detach().clone().requires_grad_() for p in ours]
    one = Adam(groups_of(ours))
    other = torch.optim.Adam(groups_of(theirs), betas=BETAS, eps=EPSILON, fused=True)
    for _ in range(5):
        give_gradients(rng, ours, theirs)
        one.step()
        other.step()
    for mine, its in zip(ours, theirs, strict=True):
        torch.testing.assert_close(mine, its, rtol=1e-6, atol=1e-7)
    expected = other.state_dict()["state"]
    assert one.numbered_state().keys() == expected.keys()
    for number, state in one.numbered_state().items():
        for name, value in state.items():
            torch.testing.assert_close(value, expected[number][name], rtol=1e-6, atol=1e-9)


def test_it_goes_on_from_a_loss_with_another_scale(rng, device):
    """As if its gradients had always been 128 times larger."""
    ours = parameters(rng, device)
    theirs = [p.detach().clone().requires_grad_() for p in ours]
    one, other = (Adam(groups_of(some)) for some in (ours, theirs))
    for number in range(6):
        give_gradients(rng, ours, theirs)
        if number == 3:
            other.load(copy.deepcopy(other.numbered_state()), 128.0)
        if number >= 3:
            for parameter in theirs:
                parameter.grad *= 128.0
        one.step()
        other.step()
    for mine, its in zip(ours, theirs, strict=True):
        torch.testing.assert_close(mine, its, rtol=1e-6, atol=1e-7)


def test_a_rate_on_the_device_counts_as_it_is_at_the_step(rng, device):
    ours = parameters(rng, device)
    rate = torch.zeros((), device=device)
    optimizer = Adam([{"params": ours, "lr": rate}])
    before = ours[0].detach().clone()
    give_gradients(rng, ours)
    optimizer.step()
    torch.testing.assert_close(ours[0].detach(), before)
    rate.fill_(0.5)
    optimizer.step()
    moved = (ours[0].detach() - before).abs()
    torch.testing.assert_close(moved, torch.full_like(moved, 0.5), rtol=0.2, atol=0.0)


def test_what_has_no_gradient_stays(rng):
    ours = parameters(rng, "cpu")
    optimizer = Adam(groups_of(ours))
    give_gradients(rng, ours)
    ours[1].grad = None
    before = ours[1].detach().clone()
    optimizer.step()
    assert torch.equal(ours[1], before)
    assert list(optimizer.numbered_state()) == [0, 2]
    optimizer.zero_grad()
    assert all(p.grad is None for p in ours)


def test_it_goes_on_from_its_state(rng):
    ours = parameters(rng, "cpu")
    optimizer = Adam(groups_of(ours))
    give_gradients(rng, ours)
    optimizer.step()
    twins = [p.detach().clone().requires_grad_() for p in ours]
    resumed = Adam(groups_of(twins))
    resumed.load(copy.deepcopy(optimizer.numbered_state()))
    give_gradients(rng, ours, twins)
    optimizer.step()
    resumed.step()
    for mine, its in zip(ours, twins, strict=True):
        assert torch.equal(mine, its)


@pytest.mark.parametrize("bad", [{9: None}, {0: {}}, {0: None}, {1: "first"}])
def test_a_state_of_other_parameters_is_refused(rng, bad):
    ours = parameters(rng, "cpu")
    optimizer = Adam(groups_of(ours))
    give_gradients(rng, ours)
    optimizer.step()
    state = optimizer.numbered_state()
    numbered = {number: state[0] if value == "first" else value for number, value in bad.items()}
    errors = KeyError, IndexError, TypeError, ValueError, AttributeError
    with pytest.raises(errors):
        Adam(groups_of(parameters(rng, "cpu"))).load(numbered)


def test_steps_need_none_of_torch_s_compiler():
    code = (
        "import sys, torch\n"
        "from deformrf.core.training.run.adam import Adam\n"
        "p = torch.ones(3, requires_grad=True)\n"
        "p.grad = torch.ones(3)\n"
        "Adam([{'params': [p], 'lr': 0.1}]).step()\n"
        "assert p[0].item() < 1.0\n"
        "print('torch._dynamo' in sys.modules)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False"]


@pytest.mark.parametrize("final_rate", [*stages.FINAL_RATES.values(), 1.0])
def test_a_rate_falls_to_its_final_share(final_rate):
    rates = [learning_rate(step, 1000, 0.02, final_rate) for step in range(1001)]
    assert rates[0] == pytest.approx(0.02)
    assert rates[500] == pytest.approx(0.01 * (1.0 + final_rate))
    assert rates[-1] == pytest.approx(0.02 * final_rate)
    assert rates == sorted(rates, reverse=True)


@pytest.mark.parametrize("hidden, share", [((64, 64), 1.0), ((32,), 1.0), ((256, 256, 64), 0.25)])
def test_the_rate_of_colors_falls_with_their_widest_layer(hidden, share):
    """Other rates stay, and so does the order, which a checkpoint counts parameters by."""
    dataset = gray_photographs(alpha=128)
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), "cpu")
    options = FieldOptions(2, 2**8, march_step=0.05, color_hidden=hidden, deferred=True)
    field = TrainingField(a15_grid(0.25), options, "cpu")
    stage = Optimization(field, bank, preset("tiny"), dataset.has_alpha, 50, 1.0)
    stage.step(0.1, False)
    groups = stage.optimizer.param_groups
    ids = [[id(weights) for weights in group["params"]] for group in groups]
    assert [*ids[0], *ids[1]] == [id(weights) for weights in field.parameters()]
    assert ids[1] == [id(weights) for weights in field.networks.color.parameters()]
    assert [group["lr"] for group in groups] == pytest.approx([0.1, 0.1 * share])
