"""The training step: it learns, and on CUDA the recorded one is the one that was written."""

import gc
import weakref

import numpy as np
import pytest
import torch
from image_datasets import from_images

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.render import pinhole
from deformrf.core.training import TrainOptions, world_to_unit_cube
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run.differentiable import on_warp_stream
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.training_field import TrainingField

SIZE = 24


@pytest.fixture
def gray_disc():
    """One view of a half-transparent gray square in the middle of nothing."""
    image = np.zeros((1, SIZE, SIZE, 4), np.uint8)
    image[:, 8:16, 8:16] = (90, 90, 90, 128)
    pose = np.eye(4)[None].copy()
    pose[0, 2, 3] = 4.0
    return from_images(image, pose, [pinhole(40.0, SIZE, SIZE)], ["r_0"], "train")


def make_run(dataset, device, seed=0):
    options = FieldOptions(level_count=4, table_size=2**10, march_step=0.02)
    field = TrainingField(a15_grid(0.2), options, device, seed)
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), device)
    options = TrainOptions(samples_per_step=2**14, seed=seed)
    run = Optimization(field, bank, options, dataset.has_alpha, 1000, 1.0)
    run.set_ray_count(200)
    return run


def test_steps_reduce_the_error(gray_disc, device):
    with on_warp_stream(device):
        run = make_run(gray_disc, device)
        errors = []
        for _ in range(70):
            run.step(1e-2, white=False)
            errors.append(float(run.error))
    assert np.mean(errors[-10:]) < 0.3 * np.mean(errors[:10])


def test_a_rate_of_zero_changes_nothing(gray_disc, device):
    with on_warp_stream(device):
        run = make_run(gray_disc, device)
        before = run.field.table.detach().clone()
        run.step(0.0, white=False)
        assert torch.equal(before, run.field.table.detach())
        run.step(1e-2, white=False)
        assert not torch.equal(before, run.field.table.detach())


def test_each_step_draws_other_rays_and_backgrounds(gray_disc, device):
    with on_warp_stream(device):
        run = make_run(gray_disc, device)
        seen, seeds = [], []
        for _ in range(3):
            run.step(0.0, white=False)
            seen.append(run.batch.directions.clone())
            seeds.append(int(run.batch.seed.numpy()[0]))
    assert not torch.equal(seen[0], seen[1])
    assert not torch.equal(seen[1], seen[2])
    assert len(set(seeds)) == 3


@pytest.mark.gpu
def test_marching_ahead_draws_what_each_step_would_draw(gray_disc):
    """Whether batches are marched during the steps before, or just now: the same rays.

    No pixel has a limit there, because nothing is opaque.
    """
    with on_warp_stream("cuda:0"):
        runs = [make_run(gray_disc, "cuda:0") for _ in range(2)]
        for _ in range(8):
            for run in runs:
                run.step(0.0, white=False)
            runs[1]._recorded._next = None
            assert torch.equal(runs[0].batch.directions, runs[1].batch.directions)
            assert torch.equal(runs[0].batch.background, runs[1].batch.background)
            assert runs[0].sample_count() == runs[1].sample_count() > 0


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def test_what_a_run_holds_is_freed_with_it(gray_disc, device):
    """At once: the stage after it needs the memory."""
    with on_warp_stream(device):
        run = make_run(gray_disc, device)
        run.step(0.0, white=False)
        alive = weakref.ref(run)
        gc.disable()
        try:
            del run
            assert alive() is None
        finally:
            gc.enable()


@pytest.mark.gpu
def test_a_recorded_step_learns_like_one_that_is_run(gray_disc, monkeypatch):
    """With and without a graph; recording takes steps of its own, so draws differ."""
    results = []
    for recorded in (True, False):
        torch.manual_seed(3)
        with on_warp_stream("cuda:0"):
            run = make_run(gray_disc, "cuda:0")
            errors = []
            for number in range(70):
                if recorded:
                    run.step(1e-2, white=False)
                else:
                    for group in run.optimizer.param_groups:
                        group["lr"].fill_(1e-2)
                    run._draw_and_learn(run.batch, number)
                errors.append(float(run.error))
            results.append(errors)
    for errors in results:
        assert np.mean(errors[-10:]) < 0.1 * np.mean(errors[:10])
