"""The loss of colors that are 0 and 1: they can be moved, and what moves them is its gradient."""

import numpy as np
import pytest
import torch
from gray_photographs import GRAY, gray_photographs

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.training import preset, world_to_unit_cube
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run import loss
from deformrf.core.training.run.differentiable import on_warp_stream
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.training_field import MOST_LOGIT, TrainingField


@pytest.fixture
def stage(device):
    """A stage with one color a ray on a few photographs of gray."""
    dataset = gray_photographs(alpha=255)
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), device)
    options = FieldOptions(2, 2**8, march_step=0.05, deferred=True, color_hidden=(64, 64))
    field = TrainingField(a15_grid(0.25), options, device)
    with on_warp_stream(device):
        stage = Optimization(field, bank, preset("tiny"), dataset.has_alpha, 1000, 1.0)
        stage.set_ray_count(64)
        yield stage


def rendered(stage):
    """The same rays each time, as `RenderedRays`."""
    stage._prepare(stage.batch, 0)
    stage._march(stage.batch)
    return stage.field.composite(stage.batch)


def push(stage, logit):
    """Move all colors' logits by that much."""
    with torch.no_grad():
        stage.field.networks.color[-1].bias += logit


def colors_of(picture):
    """Of the rays that see something.  [n, 3]"""
    seen = picture.opacity > 0.1
    assert seen.sum() > 10
    return (picture.color / picture.opacity[:, None])[seen].detach()


def after_steps(stage, logit):
    """How far colors of 0 or 1 are from the photographs' after 400 steps."""
    push(stage, logit)
    assert (colors_of(rendered(stage)) - float(logit > 0.0)).abs().max() < 1e-6
    for number in range(400):
        stage.step(0.005 * min(1.0, (number + 1) / 100.0), white=False)
    return (colors_of(rendered(stage)) - GRAY / 255.0).abs().mean()


@pytest.mark.parametrize("logit", [-20.0, 20.0])
def test_colors_of_0_and_1_can_be_moved(stage, logit):
    """At 20 the sigmoid has no slope in float32, at -20 one of 2·10⁻⁹: too little for float16."""
    assert after_steps(stage, logit) < 0.2


@pytest.mark.parametrize("device", ["cpu"])
def test_without_their_cost_colors_of_1_stay(stage, monkeypatch):
    """So the test before this one can fail."""
    monkeypatch.setattr(loss, "EXCESS_WEIGHT", 0.0)
    assert after_steps(stage, 20.0) > 0.4


@pytest.mark.parametrize("device", ["cpu"])
def test_means_are_over_all_pixels_that_were_tried(stage):
    """Three for each ray: a third of the error, of the loss and of its gradient."""
    rendered(stage)
    found = []
    for tries in 1.0, 3.0:
        stage.batch.tries.fill_(tries)
        value, error = loss.training_loss(
            stage.field, stage.batch, torch.zeros(1), stage.distortion
        )
        (gradient,) = torch.autograd.grad(value, [stage.field.table])
        found.append(torch.stack([value.detach(), error.detach(), gradient.abs().max()]))
    assert float(found[0].min()) > 0.0
    torch.testing.assert_close(found[1], found[0] / 3.0)


@pytest.mark.parametrize("device", ["cpu"])  # float16 would be too coarse for differences
@pytest.mark.parametrize("logit", [-10.0, -4.0, 4.0, 10.0])  # at 0 colors are right
def test_logits_have_the_gradient_of_the_loss(stage, logit):
    """Also where colors are nearly 0 or 1: another one led runs away from what they had learned."""
    push(stage, logit)
    white, bias = torch.zeros(1), stage.field.networks.color[-1].bias

    def value():
        rendered(stage)
        return loss.training_loss(stage.field, stage.batch, white, 0.0)[0]

    (gradient,) = torch.autograd.grad(value(), bias)
    step = 0.25
    with torch.no_grad():
        bias += step
        above = value()
        bias -= 2.0 * step
        below = value()
    slope = (above - below) / (2.0 * step)
    assert float(gradient.sum()) == pytest.approx(float(slope), rel=0.05)


def test_only_logits_beyond_the_most_cost_something(stage):
    picture = rendered(stage)
    assert picture.excess.max() == 0.0
    push(stage, MOST_LOGIT + 10.0)
    picture = rendered(stage)
    beyond = (picture.excess / picture.opacity)[picture.opacity > 0.1]
    assert ((200.0 < beyond) & (beyond < 450.0)).all()  # 3 · 10², and the start's own logits


class Plates:
    """Every third ray is untold, before one color."""

    def __call__(self, pixels):
        untold = (torch.arange(len(pixels), device=pixels.device) % 3 == 0).float()
        return torch.full((len(pixels), 3), 0.3, device=pixels.device), untold


def test_untold_rays_are_compared_with_what_is_behind_the_object(stage):
    """All others as before: over the step's background, by their alpha."""
    picture = rendered(stage)
    stage.batch.rgba[:, 3] = 0.25
    stage.field.plates = Plates()
    white = torch.ones(1, device=stage.field.torch_device)
    _, error = loss.training_loss(stage.field, stage.batch, white, 0.0)
    color, opacity, fits = (
        a.detach().double().cpu().numpy()
        for a in (picture.color, picture.opacity, stage.batch.fits)
    )
    target = stage.batch.rgba[:, :3].double().cpu().numpy()
    untold = np.arange(len(color))[:, None] % 3 == 0
    left = 1.0 - opacity[:, None]
    off = np.where(untold, color + left * 0.3 - target, color + left - 0.25 * target - 0.75)
    expected = (fits[:, None] * off**2).mean(axis=1).sum() / fits.sum()
    assert float(error.detach()) == pytest.approx(expected, rel=0.01)
