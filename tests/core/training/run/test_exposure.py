"""Color maps of photographs: what they do, their gradients, and that exposures are learned."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from ball_photos import photographs
from PIL import Image, ImageFilter

from deformrf.core.training import evaluate, load_checkpoint, preset, trainer
from deformrf.core.training.photographs import SMALL_SPREAD, learned_exposure, photographed_rays
from deformrf.core.training.run import optimization
from deformrf.core.training.run.exposure import COST, SCALE, LearnedExposure

VIEWS, RAYS = 4, 30


def adjusted_reference(color, opacity, maps, views):
    """Colors as photographs show them, in float64.  [R, 3]

    Args:
        color: Without background, that is, times opacity.  [R, 3]
        opacity: [R]
        maps: θ.  [N, 3, 4]
        views: Of each ray.  int [R]
    """
    maps = SCALE * (np.asarray(maps, float) - np.mean(maps, axis=0))
    whole = np.column_stack([color, opacity])
    return color + np.einsum("rij,rj->ri", maps[views], whole)


def cost_reference(maps) -> float:
    """The maps' price."""
    return COST * float(((SCALE * np.asarray(maps, float)) ** 2).sum(axis=(1, 2)).mean())


@pytest.fixture
def case():
    """Colors, opacities, maps and views; a module with these maps."""
    rng = np.random.default_rng()
    opacity = rng.random(RAYS)
    color = rng.random((RAYS, 3)) * opacity[:, None]
    maps, views = rng.normal(size=(VIEWS, 3, 4)), rng.integers(0, VIEWS, RAYS)
    exposure = LearnedExposure(VIEWS, "cpu").double()
    exposure.maps.data[:] = torch.from_numpy(maps)
    return (color, opacity, maps, views), exposure


def total(exposure, color, opacity, views):
    """A loss of colors and maps, by torch."""
    shown = exposure(torch.from_numpy(color), torch.from_numpy(opacity), torch.from_numpy(views))
    return (shown**2).sum() + exposure.cost()


def test_colors_and_price_are_those_of_the_reference(case):
    (color, opacity, maps, views), exposure = case
    shown = exposure(*(torch.from_numpy(a) for a in (color, opacity, views)))
    expected = adjusted_reference(color, opacity, maps, views)
    np.testing.assert_allclose(shown.detach().numpy(), expected, rtol=1e-12)
    assert exposure.cost().item() == pytest.approx(cost_reference(maps), rel=1e-12)


def test_gradients_are_finite_differences_of_the_reference(case):
    (color, opacity, maps, views), exposure = case

    def loss(maps):
        return (adjusted_reference(color, opacity, maps, views) ** 2).sum() + cost_reference(maps)

    (gradient,) = torch.autograd.grad(total(exposure, color, opacity, views), [exposure.maps])
    expected, step = np.zeros_like(maps), 1e-5
    for place in np.ndindex(maps.shape):
        change = np.zeros_like(maps)
        change[place] = step
        expected[place] = (loss(maps + change) - loss(maps - change)) / (2 * step)
    np.testing.assert_allclose(gradient.numpy(), expected, rtol=1e-6, atol=1e-8)


def test_maps_leave_the_mean_look_and_what_is_transparent(case):
    (color, _, maps, _), _ = case
    ones, views = np.ones(VIEWS), np.arange(VIEWS)
    same = np.tile(color[:1], (VIEWS, 1))
    shown = adjusted_reference(same, ones, maps, views)
    np.testing.assert_allclose(shown.mean(axis=0), color[0], rtol=1e-12)
    np.testing.assert_array_equal(adjusted_reference(0 * same, 0 * ones, maps, views), 0.0)


def exposed(dataset, gains):
    """The same photographs, brighter or darker.  gains: [N, 3]"""
    pixels = dataset.pixels.copy()
    for view, gain in enumerate(gains):
        first, last = dataset.first_pixels[view : view + 2]
        pixels[first:last, :3] = np.clip(np.round(pixels[first:last, :3] * gain), 0, 255)
    return replace(dataset, pixels=pixels)


def test_exposures_are_learned_and_the_model_is_better_for_it(monkeypatch):
    """It is compared with photographs that all have the mean exposure."""
    monkeypatch.setattr(optimization, "MOST_RAYS", 256)
    dataset = photographs(size=16)
    rng = np.random.default_rng()
    gains = rng.uniform(0.6, 1.0, (dataset.view_count, 1)) * rng.uniform(0.95, 1.0, 3)
    few = {"spacing": 0.15, "fine_steps": 120, "level_count": 3, "samples_per_step": 2**11}
    options = preset("tiny", aabb=(-0.6,) * 3 + (0.6,) * 3, **few)
    evenly = exposed(dataset, np.tile(gains.mean(axis=0), (dataset.view_count, 1)))
    decibels = []
    for words in (("coarse-stage",), ("coarse-stage", "exposure")):
        run = trainer.train(exposed(dataset, gains), replace(options, leave_out=words))
        decibels.append(evaluate(run.field, evenly)["mean"]["psnr"])
        assert ("exposure_spread" in run.report) == ("exposure" not in words)
        if "exposure_spread" in run.report:
            told = run.report["exposure_spread"], gains.mean(axis=1).std() / gains.mean()
            assert told[0] == pytest.approx(told[1], rel=0.6)  # after few steps
    assert decibels[0] > decibels[1] + 0.4  # 0.8 to 1.7, by the random gains


@pytest.mark.parametrize(
    "spread, left",
    [pytest.param(0.9 * SMALL_SPREAD, True, marks=pytest.mark.soak), (SMALL_SPREAD, False)],
)
def test_exposures_that_hardly_differ_are_left_to_the_colors(tmp_path, monkeypatch, spread, left):
    """From stage 2 on, and in a run that is resumed there."""
    monkeypatch.setattr(optimization, "MOST_RAYS", 128)
    monkeypatch.setattr(LearnedExposure, "spread", lambda self: spread)
    dataset, path = photographs(size=16), tmp_path / "run.checkpoint"
    few = {"spacing": 0.15, "coarse_steps": 80, "fine_steps": 32, "samples_per_step": 2**10}
    options = preset("tiny", aabb=(-0.6,) * 3 + (0.6,) * 3, level_count=3, **few)

    def stop_in_stage_2(pause):
        if pause.stage == 2:
            raise KeyboardInterrupt

    begun = trainer.train(dataset, options, checkpoint_path=path, on_pause=stop_in_stage_2)
    saved = load_checkpoint(path)
    resumed = trainer.train(dataset, options, resumed=saved)
    assert begun.interrupted and saved.stage == 2 and resumed.complete
    for run in (begun, resumed):
        assert run.report.get("exposure_left", False) == left
        assert run.report["exposure_spread"] == spread
    learned = [tuple(p.shape) for p in saved.fit["stage"]["parameters"]]
    assert ((dataset.view_count, 3, 4) in learned) != left


def test_images_that_no_camera_took_have_no_maps():
    dataset = photographs(3, 6)
    options = preset("tiny")
    assert learned_exposure(dataset, options, "cpu", {}).maps.shape == (3, 3, 4)
    assert learned_exposure(dataset, replace(options, leave_out=("exposure",)), "cpu", {}) is None
    cut_out = dataset.pixels.copy()
    cut_out[0, 3] = 0
    alone = replace(dataset, pixels=cut_out)
    assert learned_exposure(alone, options, "cpu", {}) is None
    assert learned_exposure(replace(alone, masked=True), options, "cpu", {}) is not None


def test_blurred_photographs_are_drawn_less_and_named():
    dataset = photographs(size=40)
    noise = np.random.default_rng().integers(0, 255, (len(dataset.pixels), 3))
    pixels = dataset.pixels.copy()
    pixels[:, :3] = noise
    first, last = dataset.first_pixels[3:5]
    image = Image.fromarray(noise[first:last].reshape(40, 40, 3).astype(np.uint8))
    pixels[first:last, :3] = np.asarray(image.filter(ImageFilter.BoxBlur(3))).reshape(-1, 3)
    dataset, said = replace(dataset, pixels=pixels), []
    options = preset("tiny", surroundings="learnt")
    place = np.eye(4), "cpu", None, None, said.append
    bank = photographed_rays(dataset, options, *place)
    counts = np.bincount(np.searchsorted(dataset.first_pixels, bank.bank.pool.numpy(), "right") - 1)
    assert (np.delete(counts, 3) == 1600).all() and counts[3] < 800
    assert len(said) == 1 and said[0].startswith("1 of 12 photographs are blurred")
    assert f"{dataset.names[3]} " in said[0]
    same = replace(options, leave_out=("blur-weights",))
    assert len(photographed_rays(dataset, same, *place).bank.pool) == 0 and len(said) == 1
