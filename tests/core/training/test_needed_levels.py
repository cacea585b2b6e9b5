"""Which levels images need, and that a model has these alone."""

import numpy as np
import pytest
import torch

from deformrf.core.field import FieldOptions, coarsest
from deformrf.core.geometry import a15_grid
from deformrf.core.render import Camera, Renderer, RenderOptions, in_space
from deformrf.core.training import needed_levels as module
from deformrf.core.training import preset, train, world_to_unit_cube
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.needed_levels import needed_levels
from deformrf.core.training.run.differentiable import on_warp_stream
from deformrf.core.training.run.training_field import TrainingField

LEVELS = 4
SMALL = preset(
    "tiny",
    spacing=0.1,
    march_step=0.02,
    table_size_log2=12,
    coarse_steps=40,
    fine_steps=96,
    samples_per_step=2**11,
    level_count=LEVELS,
)


@pytest.fixture
def bank(ball_data, device):
    views = ball_data[0]
    return RayBank(views, world_to_unit_cube(views, radius=1.5), device)


@pytest.fixture
def field(bank, device):
    """Features of all levels are large."""
    options = FieldOptions(LEVELS, 2**8, march_step=0.05, deferred=True)
    field = TrainingField(a15_grid(0.25), options, device)
    random = torch.randn(field.table.shape, generator=torch.Generator().manual_seed(3))
    field.set_weights([random, *field.parameters()[1:]])
    with on_warp_stream(device):
        yield field


def scale(field, level, factor):
    with torch.no_grad():
        field.table[field.layout.offsets[level] : field.layout.offsets[level + 1]] *= factor


@pytest.mark.parametrize("needed", range(1, LEVELS + 1))
def test_levels_of_zeros_are_needless_and_weights_stay(field, bank, needed):
    weights = [p.detach().clone() for p in field.parameters()]
    for level in range(needed, LEVELS):
        scale(field, level, 0.0)
    assert needed_levels(field, bank) == needed
    for before, after in zip(weights[1:], field.parameters()[1:], strict=True):
        assert torch.equal(before, after)


def test_a_coarse_level_of_zeros_stays_below_a_fine_one(field, bank):
    scale(field, 2, 0.0)
    assert needed_levels(field, bank) == LEVELS


def test_a_level_is_needed_from_the_rounding_of_bytes_on(field, bank, ball_data, device):
    """Compared with images of bytes, where the change of pixels is proportional to features."""
    views = ball_data[0]
    space = world_to_unit_cube(views, radius=1.5)
    camera = Camera(in_space(views.poses, space)[0], views.lenses[0])

    def change():
        """Of the object's pixels without level 3, in root mean square.  [1/255]"""
        whole = field.export(space, {})
        options = RenderOptions(background=(1.0, 1.0, 1.0))
        one, other = (
            Renderer(model, device=device).render(camera, options).color_array().astype(float)
            for model in (whole, coarsest(whole, 3))
        )
        return np.sqrt(np.square(one - other)[one[..., 3] > 0, :3].mean())

    scale(field, 3, 1e-6)
    assert needed_levels(field, bank) == 3
    while needed_levels(field, bank) == 3:
        assert change() < 0.8  # 0.29, and twice the rounding of an image
        scale(field, 3, 2.0)
    scale(field, 3, 8.0)
    assert needed_levels(field, bank) == LEVELS and change() > 1.0


def test_where_nothing_is_seen_all_levels_stay(field, bank):
    scale(field, 3, 0.0)
    field.occupied[:] = False
    field.refresh_mask()
    assert needed_levels(field, bank) == LEVELS


@pytest.mark.parametrize("bound, levels", [(0.0, LEVELS), (2.0, 1)])
def test_a_model_has_the_needed_levels_alone(ball_data, device, bound, levels, monkeypatch):
    monkeypatch.setattr(module, "ROUNDING", bound)
    run = train(ball_data[0], SMALL, device, "ball")
    assert run.complete and run.field.options.level_count == levels
    assert run.field.meta["levels_left_out"] == run.report["levels_left_out"] == LEVELS - levels


def test_an_interrupted_run_keeps_all_levels(ball_data, device, monkeypatch):
    monkeypatch.setattr(module, "ROUNDING", 2.0)

    def interrupt(pause):
        if pause.stage == 2:
            raise KeyboardInterrupt

    run = train(ball_data[0], SMALL, device, "ball", on_pause=interrupt)
    assert run.interrupted and run.field.options.level_count == LEVELS
    assert "levels_left_out" not in run.report
