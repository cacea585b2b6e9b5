"""Batches: the same samples with and without a fixed room, and rays that don't fit."""

import numpy as np
import pytest
import torch
import warp as wp

from deformrf.core.definition.networks import spherical_harmonics
from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid, tet_neighbours
from deformrf.core.render import Pose
from deformrf.core.training.data.raybank import NO_LIMIT
from deformrf.core.training.run.batch import MAX_RAY_SAMPLES, Batch
from deformrf.core.training.run.training_field import TrainingField
from deformrf.core.training.train_options import PRESETS

RAYS = 300


@pytest.fixture
def scene(make_ball_field, device):
    field = make_ball_field(int(np.random.default_rng().integers(1000)))
    pose = Pose(field.mesh, field.neighbours, device)
    return field, pose, wp.array(field.occupancy, dtype=wp.uint64, device=device)


def marched(scene, capacity, device, rays, limits=None):
    field, pose, mask = scene
    batch = Batch(RAYS, capacity, device)
    for mine, given in zip((batch.origins, batch.directions), rays, strict=True):
        mine.copy_(torch.from_numpy(given.astype(np.float32)))
    batch.seed.fill_(5)
    if limits is not None:
        batch.drawn.limits.assign(limits.astype(np.int32))
    batch.march(pose, mask, field.options.march_step)
    return batch


def random_rays():
    rng = np.random.default_rng()
    origins = rng.normal(size=(RAYS, 3))
    origins = 0.5 + 1.5 * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.uniform(0.3, 0.7, (RAYS, 3)) - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_a_fixed_room_holds_the_same_samples(scene, device):
    rays = random_rays()
    exact = marched(scene, None, device, rays)
    count = len(exact.samples.tet)
    roomy = marched(scene, count + 1000, device, rays)
    assert int(roomy.sample_count.numpy()[0]) == count > 1000
    for name in ("tet", "bary", "length", "t"):
        mine = getattr(roomy.samples, name).numpy()[:count]
        np.testing.assert_array_equal(mine, getattr(exact.samples, name).numpy())
    assert (roomy.samples.tet.numpy()[count:] == -1).all()
    assert (exact.samples.tet.numpy() >= 0).all()
    assert bool((roomy.fits == 1.0).all())


def test_rays_that_do_not_fit_are_left_out(scene, device):
    rays = random_rays()
    exact = marched(scene, None, device, rays)
    room = len(exact.samples.tet) // 2
    tight = marched(scene, room, device, rays)
    fits = tight.fits.cpu().numpy() == 1.0
    np.testing.assert_array_equal(fits, exact.ends.numpy() <= room)
    np.testing.assert_array_equal(tight.counts.numpy(), np.where(fits, exact.counts.numpy(), 0))
    count = int(tight.sample_count.numpy()[0])
    assert count == tight.counts.numpy().sum() <= room
    np.testing.assert_array_equal(
        tight.samples.bary.numpy()[:count], exact.samples.bary.numpy()[:count]
    )
    assert (tight.samples.tet.numpy()[count:] == -1).all()


def test_a_ray_ends_at_its_limit(scene, device):
    rays = random_rays()
    whole = marched(scene, None, device, rays)
    counts = whole.counts.numpy()
    limits = np.random.default_rng().integers(1, counts.max() + 1, RAYS)
    limits[::3] = int(NO_LIMIT)
    cut = marched(scene, None, device, rays, limits)
    expected = np.where(limits == NO_LIMIT, counts, np.minimum(counts, limits))
    np.testing.assert_array_equal(cut.counts.numpy(), expected)
    assert expected.sum() < counts.sum()
    ray = np.repeat(np.arange(RAYS), counts)
    number = np.arange(len(ray)) - (np.cumsum(counts) - counts)[ray]
    for name in ("tet", "bary", "length", "t"):
        kept = getattr(whole.samples, name).numpy()[number < expected[ray]]
        np.testing.assert_array_equal(getattr(cut.samples, name).numpy(), kept)


def test_no_ray_of_any_preset_is_cut_off():
    """Through the whole grid, all of it occupied, along the cube's diagonal."""
    options = PRESETS["default"]
    mesh = a15_grid(options.spacing)
    pose = Pose(mesh, tet_neighbours(mesh.tets), "cpu")
    mask = wp.full(mesh.tet_count, 2**64 - 1, dtype=wp.uint64, device="cpu")
    batch = Batch(8, None, "cpu")
    start = np.random.default_rng().uniform(-0.02, 0.0, (8, 3))
    direction = (1.0 - 2.0 * start) / np.linalg.norm(1.0 - 2.0 * start, axis=1, keepdims=True)
    batch.origins.copy_(torch.from_numpy((start - 0.5 * direction).astype(np.float32)))
    batch.directions.copy_(torch.from_numpy(direction.astype(np.float32)))
    batch.march(pose, mask, options.march_step)
    assert np.sqrt(3) / options.march_step < batch.counts.numpy().max() < MAX_RAY_SAMPLES


def test_no_room_at_all_is_no_sample(make_ball_field, device):
    field = make_ball_field(1, occupied_share=1.0)  # so that the ray has samples
    pose = Pose(field.mesh, field.neighbours, device)
    mask = wp.array(field.occupancy, dtype=wp.uint64, device=device)
    batch = Batch(1, 1, device)
    batch.origins.copy_(torch.tensor([[0.5, 0.5, 3.0]]))
    batch.directions.copy_(torch.tensor([[0.0, 0.0, -1.0]]))
    batch.march(pose, mask, field.options.march_step)
    assert int(batch.sample_count.numpy()[0]) == 0
    assert batch.fits.item() == 0.0


def test_a_batch_is_marched_through_its_own_occupancy(make_ball_field, device):
    """What is marched ahead keeps the occupancy that it was given."""
    ball = make_ball_field(1)
    field = TrainingField(ball.mesh, FieldOptions(2, 2**8, march_step=0.05), device)
    batch = Batch(1, None, device)
    batch.origins.copy_(torch.tensor([[0.5, 0.5, 3.0]]))
    batch.directions.copy_(torch.tensor([[0.0, 0.0, -1.0]]))
    field.march(batch)
    assert int(batch.sample_count.numpy()[0]) > 0
    batch.mask = wp.zeros_like(field.mask)
    field.march(batch)
    assert int(batch.sample_count.numpy()[0]) == 0


def test_rays_that_are_not_in_use_have_no_samples(scene, device):
    rays = random_rays()
    whole = marched(scene, 20_000, device, rays)
    field, pose, mask = scene
    batch = Batch(RAYS, 20_000, device)
    batch.seed.fill_(5)
    for used in (RAYS // 3, RAYS // 2, RAYS):
        batch.use(used)
        batch.origins.copy_(whole.origins)
        batch.directions.copy_(whole.directions)
        batch.march(pose, mask, field.options.march_step)
        counts = whole.counts.numpy().copy()
        counts[used:] = 0
        np.testing.assert_array_equal(batch.counts.numpy(), counts)
        assert batch.fits.cpu().tolist() == [1.0] * used + [0.0] * (RAYS - used)
        count = int(batch.sample_count.numpy()[0])
        assert count == counts.sum() > 0
        np.testing.assert_array_equal(
            batch.samples.t.numpy()[:count], whole.samples.t.numpy()[:count]
        )


def test_the_basis_is_that_of_each_samples_ray(scene, device):
    rays = random_rays()
    batch = marched(scene, None, device, rays)
    ray = np.repeat(np.arange(RAYS), batch.counts.numpy())
    expected = spherical_harmonics(rays[1])[ray]
    np.testing.assert_allclose(batch.basis.cpu().numpy(), expected, atol=2e-4)  # Q is I to 1e-5
