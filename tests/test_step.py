"""The training step: it learns, and on CUDA the recorded one is the one that was written."""

import numpy as np
import pytest
import torch

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.render import pinhole
from deformrf.core.training import world_to_unit_cube
from deformrf.core.training.data.datasets import from_images
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run.differentiable import on_warp_stream
from deformrf.core.training.run.stage import Stage
from deformrf.core.training.run.step import Step

SIZE = 24


@pytest.fixture
def gray_disc():
    """One view of a half-transparent gray square in the middle of nothing."""
    image = np.zeros((1, SIZE, SIZE, 4), np.uint8)
    image[:, 8:16, 8:16] = (90, 90, 90, 128)
    pose = np.eye(4)[None].copy()
    pose[0, 2, 3] = 4.0
    return from_images(image, pose, [pinhole(40.0, SIZE, SIZE)], ["r_0"], "train")


def make_step(dataset, device, seed=0):
    options = FieldOptions(level_count=4, table_size=2**10, march_step=0.02)
    stage = Stage(a15_grid(0.2), options, device, seed)
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), device)
    step = Step(stage, bank, 1e-2, 2**14, seed)
    step.set_ray_count(200)
    return step


def test_steps_reduce_the_error(gray_disc, device):
    with on_warp_stream(device):
        step = make_step(gray_disc, device)
        errors = []
        for _ in range(70):
            step.run(1e-2, white=False)
            errors.append(float(step.error))
    assert np.mean(errors[-10:]) < 0.3 * np.mean(errors[:10])


def test_a_rate_of_zero_changes_nothing(gray_disc, device):
    with on_warp_stream(device):
        step = make_step(gray_disc, device)
        before = step.stage.table.detach().clone()
        step.run(0.0, white=False)
        assert torch.equal(before, step.stage.table.detach())
        step.run(1e-2, white=False)
        assert not torch.equal(before, step.stage.table.detach())


def test_each_step_draws_other_rays_and_backgrounds(gray_disc, device):
    with on_warp_stream(device):
        step = make_step(gray_disc, device)
        seen, seeds = [], []
        for _ in range(3):
            step.run(0.0, white=False)
            seen.append(step.batch.directions.clone())
            seeds.append(int(step.batch.seed.numpy()[0]))
    assert not torch.equal(seen[0], seen[1])
    assert not torch.equal(seen[1], seen[2])
    assert len(set(seeds)) == 3


def run_eagerly(step):
    batch = step.batch
    step._seed_batch(batch, step.number)
    step._march(batch)
    step._learn(batch)


@pytest.mark.gpu
def test_marching_ahead_draws_what_each_step_would_draw(gray_disc):
    """Whether a batch is marched during the step before, or just now: the same rays."""
    with on_warp_stream("cuda:0"):
        steps = [make_step(gray_disc, "cuda:0") for _ in range(2)]
        for _ in range(4):
            for step in steps:
                step.run(0.0, white=False)
            steps[1]._next_is_marched = False
            assert torch.equal(steps[0].batch.directions, steps[1].batch.directions)
            assert torch.equal(steps[0].batch.background, steps[1].batch.background)
            assert steps[0].sample_count() == steps[1].sample_count() > 0


@pytest.mark.gpu
def test_a_recorded_step_learns_like_one_that_is_run(gray_disc, monkeypatch):
    """With and without a graph; recording takes steps of its own, so draws differ."""
    results = []
    for recorded in (True, False):
        torch.manual_seed(3)
        with on_warp_stream("cuda:0"):
            step = make_step(gray_disc, "cuda:0")
            if not recorded:
                monkeypatch.setattr(step, "_run_graphs", lambda step=step: run_eagerly(step))
            errors = []
            for _ in range(70):
                step.run(1e-2, white=False)
                errors.append(float(step.error))
            results.append(errors)
    for errors in results:
        assert np.mean(errors[-10:]) < 0.1 * np.mean(errors[:10])
