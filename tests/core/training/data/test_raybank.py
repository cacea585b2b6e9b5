"""Drawn rays are those of the cameras and their lenses; all pixels are drawn equally often."""

import numpy as np
import pytest
import warp as wp
from image_datasets import from_images

from deformrf.core.render import Camera, Lens, camera_rays, in_space, look_at
from deformrf.core.training import world_to_unit_cube
from deformrf.core.training.data.raybank import EMPTY, MOST_TRIES, NO_LIMIT, RayBank, empty_drawn

LENSES = (
    Lens(7, 5, (9.0, 8.0), (3.2, 2.6), (0.05, -0.08, 0.01, 0.0), (-1e-3, 2e-3)),
    Lens(4, 9, (11.0, 11.0), (2.0, 4.5)),
    Lens(6, 6, (8.0, 8.5), (2.5, 3.5), (-0.2, 0.03, 0.0, 0.0)),
)


def views():
    """Three photographs of three shapes, all of random pixels."""
    rng = np.random.default_rng()
    images = [rng.integers(0, 256, (lens.height, lens.width, 4), np.uint8) for lens in LENSES]
    poses = [look_at(rng.normal(size=3) * 3, rng.normal(size=3) * 0.1) for _ in LENSES]
    return from_images(images, poses, LENSES, "abc", "train")


def test_rays_are_those_of_the_cameras(device):
    dataset = views()
    world_to_model = world_to_unit_cube(dataset, radius=1.5)
    bank = RayBank(dataset, world_to_model, device)
    assert bank.pixel_count == 7 * 5 + 4 * 9 + 6 * 6
    chosen = np.random.default_rng().permutation(bank.pixel_count).astype(np.int32)
    drawn = empty_drawn(len(chosen), device)
    seed = wp.zeros(1, dtype=int, device=device)
    bank.draw(seed, drawn, wp.array(chosen, dtype=int, device=device))
    poses = in_space(dataset.poses, world_to_model)
    rays = [camera_rays(Camera(pose, lens)) for lens, pose in zip(LENSES, poses, strict=True)]
    origins, directions = (np.concatenate(part)[chosen] for part in zip(*rays, strict=True))
    np.testing.assert_allclose(drawn.origins.numpy(), origins, atol=1e-6)
    np.testing.assert_allclose(drawn.directions.numpy(), directions, atol=2e-6)
    np.testing.assert_allclose(drawn.rgba.numpy() * 255, dataset.pixels[chosen], atol=1e-4)
    views_of = np.repeat(np.arange(3), [lens.width * lens.height for lens in LENSES])
    np.testing.assert_array_equal(drawn.views.numpy(), views_of[chosen])


def test_the_same_seed_draws_the_same_rays(device):
    bank = RayBank(views(), np.eye(4), device)
    drawn = []
    for seed in (1, 1, 2):
        drawn.append(empty_drawn(50, device))
        bank.draw(wp.full(1, seed, dtype=int, device=device), drawn[-1])
    first, same, other = (d.directions.numpy() for d in drawn)
    np.testing.assert_array_equal(first, same)
    assert (first != other).any(axis=1).mean() > 0.8


def test_every_pixel_is_as_likely_as_any_other(device):
    dataset = views()
    count = len(dataset.pixels)
    # Colors that tell the pixels apart.
    pixels = np.stack([np.arange(count), np.zeros(count), np.zeros(count), np.full(count, 255)], 1)
    dataset.pixels[:] = pixels
    bank = RayBank(dataset, np.eye(4), device)
    drawn = empty_drawn(200 * count, device)
    seed = int(np.random.default_rng().integers(2**30))
    bank.draw(wp.full(1, seed, dtype=int, device=device), drawn)
    often = np.bincount((drawn.rgba.numpy()[:, 0] * 255).round().astype(int), minlength=count)
    # Each is binomial with mean 200 and deviation 14.
    assert np.abs(often - 200).max() < 6 * 14


def test_empty_pixels_are_drawn_less_often_and_the_others_stand_for_them(device):
    dataset = views()
    bank = RayBank(dataset, np.eye(4), device)
    rng, count = np.random.default_rng(), bank.pixel_count
    limits = rng.integers(1, int(NO_LIMIT) + 1, count)
    limits[rng.random(count) < 0.5] = int(EMPTY)
    drawn = empty_drawn(300 * count, device)
    seed = wp.full(1, int(rng.integers(2**30)), dtype=int, device=device)
    bank.draw(seed, drawn, limits=wp.array(limits.astype(np.uint8), device=device))
    pixels, tries = drawn.pixels.numpy(), drawn.tries.numpy()
    given = np.where(limits == EMPTY, NO_LIMIT, limits)  # one that is drawn is marched wholly
    np.testing.assert_array_equal(drawn.limits.numpy(), given[pixels])
    np.testing.assert_allclose(drawn.rgba.numpy() * 255, dataset.pixels[pixels], atol=1e-4)
    assert tries.min() == 1.0 and tries.max() == MOST_TRIES
    # A mean over all pixels of what is 0 in the empty ones.
    values = np.where(limits == EMPTY, 0.0, rng.random(count))
    found, expected = values[pixels].sum() / tries.sum(), values.mean()
    assert found == pytest.approx(expected, rel=6.0 / np.sqrt(len(pixels)) / expected)
    assert 0.05 < (limits[pixels] == EMPTY).mean() < 0.15


def test_only_pixels_whose_rays_meet_a_box_are_drawn_if_asked_for(device):
    dataset, box = views(), np.array([[0.45, 0.4, 0.42], [0.6, 0.55, 0.5]])
    world_to_model = world_to_unit_cube(dataset, radius=1.5)
    bank = RayBank(dataset, world_to_model, device)
    bank.draw_from(box)
    drawn = empty_drawn(2000, device)
    bank.draw(wp.ones(1, dtype=int, device=device), drawn)
    origins, directions = drawn.origins.numpy(), drawn.directions.numpy()

    def meets(origins, directions):
        ends = (box[:, None] - origins) / directions
        return np.min(ends.max(axis=0), axis=1) > np.max(ends.min(axis=0), axis=1)

    assert meets(origins, directions).all()
    poses = in_space(dataset.poses, world_to_model)
    rays = [camera_rays(Camera(pose, lens)) for lens, pose in zip(LENSES, poses, strict=True)]
    expected = sum(meets(*pair).sum() for pair in rays)
    assert 0 < expected < bank.pixel_count
    assert len(np.unique(directions.round(6), axis=0)) == expected


def test_of_other_rays_a_share_is_drawn_as_well(device):
    dataset, box = views(), np.array([[0.45, 0.4, 0.42], [0.6, 0.55, 0.5]])
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), device)
    bank.draw_from(box)
    alone, count = bank.bank.pool.numpy(), bank.drawn_pixel_count
    bank.draw_from(box, others=0.5)
    pool = bank.bank.pool.numpy()
    assert count == len(alone) and np.isin(alone, pool).all()
    assert bank.drawn_pixel_count == len(pool)
    # The others are binomial with mean `count` and less than its deviation.
    assert abs(len(pool) - 2 * count) < 6 * np.sqrt(count)
    bank.draw_from(box, shares=[0.0] * 3, others=0.5)
    assert len(bank.bank.pool) == 0, "all, if none is left"
    assert bank.drawn_pixel_count == bank.pixel_count
    bank.draw_from(box, others=0.999)
    assert len(bank.bank.pool) == bank.pixel_count


def test_of_views_that_count_less_fewer_pixels_are_drawn(device):
    dataset = views()
    bank = RayBank(dataset, np.eye(4), device)
    bank.draw_from(shares=[1.0, 0.0, 0.5])
    drawn = empty_drawn(4000, device)
    bank.draw(wp.ones(1, dtype=int, device=device), drawn)
    often = np.bincount(drawn.views.numpy(), minlength=3)
    assert often[1] == 0
    assert often[0] / 35 == pytest.approx(often[2] / (0.5 * 36), rel=0.6)
    bank.draw_from()
    bank.draw_from(shares=[0.0, 0.0, 0.0])
    assert len(bank.bank.pool) == 0, "all, if none is left"


def test_pixels_that_are_left_out_are_not_drawn(device):
    dataset = views()
    bank = RayBank(dataset, np.eye(4), device)
    drawn, seed = empty_drawn(2000, device), wp.zeros(1, dtype=int, device=device)
    untold = np.arange(bank.pixel_count) % 3 == 0
    bank.draw_from(untold=untold)
    bank.draw(seed, drawn)
    told = np.flatnonzero(~untold)
    np.testing.assert_array_equal(np.unique(drawn.pixels.numpy()), told)


def test_views_that_are_held_aside_are_not_drawn(device):
    """Those that a box or a mask took away neither; afterwards all are again."""
    bank = RayBank(views(), np.eye(4), device)
    untold = np.zeros(bank.pixel_count, bool)
    untold[-6:] = True

    def drawn():
        batch = empty_drawn(2000, device)
        bank.draw(wp.full(1, 7, dtype=int, device=device), batch)
        return set(batch.pixels.numpy().tolist())

    first, second, third = range(35), range(35, 71), range(71, 107)
    with bank.holding_aside([0, 2]) as held:
        assert {*held} == {*first, *third}
        assert drawn() == {*second} and bank.drawn_pixel_count == 36
    assert drawn() == {*first, *second, *third}
    bank.draw_from(untold=untold)
    with bank.holding_aside([1]) as held:
        assert {*held} == {*second}
        assert drawn() == {*first, *third} - {*range(101, 107)}
    assert drawn() == {*range(101)}
