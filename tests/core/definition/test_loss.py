"""The loss is what training makes small: of the same rays and samples, `training_loss` has it."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from compositing import composite
from gray_photographs import gray_photographs

from deformrf.core.definition import loss
from deformrf.core.definition.networks import colors, geometry, sigma_from
from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.training import preset, world_to_unit_cube
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run.differentiable import on_warp_stream
from deformrf.core.training.run.loss import add_table_decay, training_loss
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.training_field import TrainingField


def stage_of(color_a_ray: bool, logit: float):
    """A stage on photographs with alpha, whose colors' logits are moved by that much."""
    dataset = gray_photographs(alpha=200)
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), "cpu")
    options = FieldOptions(2, 2**8, march_step=0.05, deferred=color_a_ray, color_hidden=(64, 64))
    stage = Optimization(
        TrainingField(a15_grid(0.25), options, "cpu"),
        bank,
        preset("tiny"),
        dataset.has_alpha,
        1000,
        1.0,
    )
    stage.set_ray_count(64)
    with torch.no_grad():
        stage.field.table += 0.5 * torch.randn(
            stage.field.table.shape, generator=torch.Generator().manual_seed(48)
        )
        stage.field.networks.color[-1].bias += logit
    stage._prepare(stage.batch, 0)
    stage._march(stage.batch)
    return stage


def defined(stage, depth_weight):
    """The loss of the stage's batch, by the definition."""
    batch, field = stage.batch, stage.field.export(np.eye(4), {}).definition
    counts = batch.counts.numpy()
    used = slice(int(counts.sum()))
    tet, bary = batch.samples.tet.numpy()[used], batch.samples.bary.numpy()[used].astype(float)
    directions = batch.directions.numpy().astype(float)
    h = geometry(field, tet, bary)
    lengths, t = (a.numpy()[used].astype(float) for a in (batch.samples.length, batch.samples.t))
    values = h
    if not field.color_per_ray:
        values = colors(h, np.repeat(directions, counts, axis=0), field.color_layers)
    sums, opacity, _, distortions, leads = composite(sigma_from(h), values, lengths, t, counts)
    color, excess = sums, np.zeros(len(counts))
    if field.color_per_ray:
        color, excess = loss.ray_colors_and_excess(sums, opacity, directions, field.color_layers)
    pictures = batch.rgba.numpy().astype(float), batch.background.numpy().astype(float)
    terms = distortions, excess, *pictures, depth_weight * leads
    return loss.batch_loss(color, opacity, *terms), excess, opacity


@pytest.mark.parametrize(
    ("color_a_ray", "logit", "depth_weight"),
    [(True, 0.0, 0.0), (True, 12.0, 0.0), (True, -12.0, 0.3), (False, 0.0, 0.3)],
)
def test_a_batch_costs_what_training_says(color_a_ray, logit, depth_weight):
    depth = torch.full((1,), depth_weight) if depth_weight else None
    with on_warp_stream("cpu"):
        stage = stage_of(color_a_ray, logit)
        with torch.no_grad():
            value, _ = training_loss(
                stage.field, stage.batch, torch.zeros(1), loss.DISTORTION_WEIGHT, None, depth
            )
    expected, excess, opacity = defined(stage, depth_weight)
    assert float(value) == pytest.approx(expected, rel=1e-4)
    assert 0.05 < opacity.mean() < 1.0
    assert (excess.max() > 1.0) == (logit != 0.0)


def test_the_tables_decay_has_the_gradient_that_training_adds():
    """It is quadratic, so differences over any step are exact."""
    field = stage_of(True, 0.0).field
    gradient = torch.zeros_like(field.table)
    add_table_decay(gradient, field, 0.3)
    entries, offsets = field.table.detach().double().numpy(), field.layout.offsets

    def cost(rows):
        return loss.table_decay([rows[a:b] for a, b in pairwise(offsets)], 0.3)

    random = np.random.default_rng()
    for entry in (0, int(random.integers(offsets[1])), int(offsets[-1]) - 1):
        step = np.zeros_like(entries)
        step[entry, 2] = 1.0
        slope = (cost(entries + step) - cost(entries - step)) / 2.0
        assert slope == pytest.approx(float(gradient[entry, 2]), rel=1e-4)


def test_one_opaque_piece_has_the_distortion_of_its_own_extent_alone():
    one = np.ones(1)
    assert loss.distortion(one, one, 0.3 * one) == pytest.approx(0.1)
