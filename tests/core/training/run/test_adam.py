"""Our Adam against torch's: the same weights, the same state, none of torch's compiler."""

import copy
import subprocess
import sys

import numpy as np
import pytest
import torch

from deformrf.core.training.run.adam import Adam

BETAS, EPSILON, RATES = (0.9, 0.99), 1e-15, (0.01, 0.03)


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
    one = Adam(groups_of(ours), BETAS, EPSILON)
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
    one, other = (Adam(groups_of(some), BETAS, EPSILON) for some in (ours, theirs))
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
    optimizer = Adam([{"params": ours, "lr": rate}], BETAS, EPSILON)
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
    optimizer = Adam(groups_of(ours), BETAS, EPSILON)
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
    optimizer = Adam(groups_of(ours), BETAS, EPSILON)
    give_gradients(rng, ours)
    optimizer.step()
    twins = [p.detach().clone().requires_grad_() for p in ours]
    resumed = Adam(groups_of(twins), BETAS, EPSILON)
    resumed.load(copy.deepcopy(optimizer.numbered_state()))
    give_gradients(rng, ours, twins)
    optimizer.step()
    resumed.step()
    for mine, its in zip(ours, twins, strict=True):
        assert torch.equal(mine, its)


@pytest.mark.parametrize("bad", [{9: None}, {0: {}}, {0: None}, {1: "first"}])
def test_a_state_of_other_parameters_is_refused(rng, bad):
    ours = parameters(rng, "cpu")
    optimizer = Adam(groups_of(ours), BETAS, EPSILON)
    give_gradients(rng, ours)
    optimizer.step()
    state = optimizer.numbered_state()
    numbered = {number: state[0] if value == "first" else value for number, value in bad.items()}
    errors = KeyError, IndexError, TypeError, ValueError, AttributeError
    with pytest.raises(errors):
        Adam(groups_of(parameters(rng, "cpu")), BETAS, EPSILON).load(numbered)


def test_steps_need_none_of_torch_s_compiler():
    code = (
        "import sys, torch\n"
        "from deformrf.core.training.run.adam import Adam\n"
        "p = torch.ones(3, requires_grad=True)\n"
        "p.grad = torch.ones(3)\n"
        "Adam([{'params': [p], 'lr': 0.1}], (0.9, 0.99), 1e-15).step()\n"
        "assert p[0].item() < 1.0\n"
        "print('torch._dynamo' in sys.modules)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False"]
