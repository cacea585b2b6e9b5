"""Limits of samples: what a pixel remembers of its ray, and that no gradient misses the rest."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from gray_photographs import gray_photographs

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.training import preset, world_to_unit_cube
from deformrf.core.training.data.raybank import EMPTY, NO_LIMIT, RayBank
from deformrf.core.training.run.batch import Batch
from deformrf.core.training.run.differentiable import on_warp_stream
from deformrf.core.training.run.loss import training_loss
from deformrf.core.training.run.monitoring import TrainingProgress
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.sample_limits import (
    OPAQUE_TRANSMITTANCE,
    SPARE,
    SPARE_SHARE,
    SampleLimits,
)
from deformrf.core.training.run.training_field import TrainingField

NONE = int(NO_LIMIT)


def needed(visible):
    return int((1.0 + SPARE_SHARE) * visible + SPARE)


RAYS = {  # alpha, limit, samples, opacity, visible, fits -> fits, what the pixel has then
    "opaque": (1.0, NONE, 90, 1.0, 20, 1.0, 1.0, needed(20)),
    "within its limit": (1.0, 30, 30, 1.0 - 0.5 * OPAQUE_TRANSMITTANCE, 25, 1.0, 1.0, needed(25)),
    "opaque late": (1.0, NONE, 900, 1.0, 800, 1.0, 1.0, NONE),
    "not opaque": (1.0, NONE, 90, 1.0 - 2.0 * OPAQUE_TRANSMITTANCE, 90, 1.0, 1.0, NONE),
    "not opaque before its limit": (1.0, 30, 29, 0.5, 29, 1.0, 1.0, NONE),
    "cut off too early": (1.0, 30, 30, 0.5, 30, 1.0, 0.0, NONE),
    "empty": (0.0, NONE, 0, 0.0, 0, 1.0, 1.0, int(EMPTY)),
    "empty, but shows something": (0.1, NONE, 0, 0.0, 0, 1.0, 1.0, NONE),
    "not in use": (0.0, NONE, 0, 0.0, 0, 0.0, 0.0, 77),
}


@pytest.mark.parametrize("skips_empty", [True, False])
def test_what_a_pixel_remembers_of_its_ray(device, skips_empty):
    alpha, limits, counts, opacity, visible, fits, fits_then, expected = map(
        list, zip(*RAYS.values(), strict=True)
    )
    learned = SampleLimits(len(RAYS) + 1, skips_empty, device)
    assert (learned.of_pixels.numpy() == NONE).all()
    learned.of_pixels.fill_(77)
    batch = Batch(len(RAYS), 8, device)
    pixels = np.random.default_rng().permutation(len(RAYS)).astype(np.int32)
    batch.drawn.pixels.assign(pixels)
    batch.drawn.limits.assign(np.array(limits, np.int32))
    batch.counts.assign(np.array(counts, np.int32))
    on_device = {"device": batch.fits.device}
    batch.rgba[:, 3] = torch.tensor(alpha, **on_device)
    batch.fits.copy_(torch.tensor(fits))
    learned.judge(
        batch,
        torch.tensor(opacity, dtype=torch.float32, **on_device),
        torch.tensor(visible, dtype=torch.int32, **on_device),
    )
    assert batch.fits.tolist() == fits_then
    assert (learned.of_pixels.numpy() == 77).all(), "before the step is done"
    learned.keep(batch)
    expected = [NONE if x == EMPTY and not skips_empty else x for x in expected]
    assert learned.of_pixels.numpy()[pixels].tolist() == expected
    assert learned.of_pixels.numpy()[-1] == 77  # nobody drew it
    learned.forget()
    assert (learned.of_pixels.numpy() == NONE).all()


def test_an_interrupted_run_keeps_its_limits():
    learned = SampleLimits(9, True, "cpu")
    limits = np.random.default_rng().integers(0, 256, 9).astype(np.uint8)
    learned.load(torch.from_numpy(limits))
    assert learned.of_pixels.numpy().tolist() == limits.tolist()
    learned.load(None)
    assert learned.of_pixels.numpy().tolist() == limits.tolist()
    for others in (torch.zeros(8, dtype=torch.uint8), torch.zeros(9)):
        with pytest.raises(ValueError, match="9 pixels"):
            learned.load(others)


def make_stage(device, alpha, size=1.0):
    """A stage on photographs of gray; its mesh has that part of the unit cube's width."""
    dataset = gray_photographs(alpha=alpha)
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), device)
    mesh = a15_grid(0.25)
    mesh = replace(mesh, rest_vertices=0.5 + size * (mesh.rest_vertices - 0.5))
    field = TrainingField(mesh, FieldOptions(2, 2**8, march_step=0.02), device)
    return Optimization(field, bank, preset("tiny"), dataset.has_alpha, 1000, 1.0)


@pytest.fixture
def stage(device):
    """A stage on photographs of opaque gray."""
    with on_warp_stream(device):
        yield make_stage(device, alpha=255)


def gradients(stage, limits):
    """Loss and gradients of the same rays, and their samples."""
    batch = Batch(256, None, stage.field.device)
    batch.seed.fill_(12)
    stage.bank.draw(batch.seed, batch.drawn, limits=limits.of_pixels)
    stage.field.march(batch)
    white = torch.ones(1, device=stage.field.torch_device)
    loss, _ = training_loss(stage.field, batch, white, stage.distortion, limits)
    found = torch.autograd.grad(loss, stage.field.parameters())
    limits.keep(batch)
    return float(loss.detach()), found, int(batch.counts.numpy().sum()), float(batch.fits.mean())


@pytest.mark.parametrize("device", ["cpu"])  # float16 would be too coarse for differences
def test_what_lies_behind_something_opaque_is_no_loss(stage):
    """The same rays have fewer samples and, as nearly as they are opaque, the same gradients."""
    with torch.no_grad():
        stage.field.table.normal_()
        stage.field.networks.density[-1].bias[0] += 4.0
    limits = SampleLimits(stage.bank.pixel_count, False, stage.field.device)
    loss, whole, count, _ = gradients(stage, limits)
    assert (limits.of_pixels.numpy() < NONE).sum() > 64
    again, cut, fewer, fits = gradients(stage, limits)
    assert fewer < 0.8 * count and fits > 0.9
    assert again == pytest.approx(loss, rel=0.05)
    for a, b in zip(whole, cut, strict=True):
        assert float((a - b).norm()) < 0.1 * float(a.norm())


def test_steps_learn_limits_and_use_them(device):
    """Photographs of nothing, with a mesh that few rays meet; then opaque ones.  CUDA records."""
    with on_warp_stream(device):
        stage = make_stage(device, alpha=0, size=0.1)
        for _ in range(60):
            stage.step(0.0, white=True)
        limits = stage._limits.of_pixels.numpy()
        assert (limits == EMPTY).any() and (limits == NONE).any()
        assert stage.batch.tries.max() > 1.0

        stage = make_stage(device, alpha=255)
        with torch.no_grad():
            stage.field.table.normal_()
            stage.field.networks.density[-1].bias[0] += 4.0
        for _ in range(20):
            stage.step(0.0, white=True)
        drawn = stage.batch.drawn.limits.numpy()
        assert (drawn < NONE).mean() > 0.2
        limited = drawn < NONE
        assert (stage.batch.counts.numpy()[limited] <= drawn[limited]).all()


def test_after_a_return_rays_have_no_limits(stage, monkeypatch):
    """What a field that has diverged taught pixels is forgotten."""
    stage._limits.of_pixels.fill_(3)
    stage._prepare(stage.batch, 0)
    stage._march(stage.batch)
    stage._shown = 0
    with TrainingProgress(False) as progress:
        task = progress.begin("stage", 50)
        for said, limit in (None, 3), ("It went back.", NONE):
            monkeypatch.setattr(stage._watch, "examine", lambda *_, said=said: said)
            stage._examine(progress, task, lambda *_: None)
            assert (stage._limits.of_pixels.numpy() == limit).all()
