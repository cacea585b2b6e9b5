"""Plates behind an object that turns: where they are, their first colors, and what they teach."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from image_datasets import from_images

from deformrf.core.render import Lens, look_at
from deformrf.core.training import UNTOLD
from deformrf.core.training.run import plates

LENS = Lens(16, 12, (20.0, 20.0), (8.0, 6.0))


@pytest.fixture
def dataset():
    """Five masked views of random pixels; 0, 2 and 3 are a ring."""
    rng = np.random.default_rng()
    images = rng.integers(0, 256, (5, 12, 16, 4)).astype(np.uint8)
    images[..., 3] = rng.choice([0, UNTOLD, 200, 255], (5, 12, 16))
    poses = [look_at(rng.normal(size=3) + np.eye(3)[0] * 3.0, np.zeros(3)) for _ in range(5)]
    views = from_images(list(images), poses, [LENS] * 5, "abcde", "train")
    return replace(views, masked=True, rings=np.array([1, -1, 1, 1, -1]))


@pytest.mark.parametrize("side", [1024, 8])
def test_first_colors(dataset, side, monkeypatch):
    """At a place, the mean of the background that masks tell, or else of all that is untold."""
    monkeypatch.setattr(plates, "SIDE", side)
    learned = plates.learned_plates(dataset, "cpu")
    step = max(1, 16 // side)
    images = dataset.pixels.reshape(5, 12, 16, 4).astype(np.float64)
    pixels = torch.arange(5 * 12 * 16, dtype=torch.int32)
    colors, untold = (a.detach().numpy() for a in learned(pixels))
    ring = [0, 2, 3]
    for n in np.random.default_rng().permutation(len(pixels))[:200]:
        view, row, column = np.unravel_index(n, (5, 12, 16))
        expected = view in ring and images[view, row, column, 3] == UNTOLD
        assert untold[n] == expected
        if not expected:
            continue
        rows, columns = (slice(a // step * step, (a // step + 1) * step) for a in (row, column))
        there = images[ring, rows, columns].reshape(-1, 4)
        told, alpha = there[there[:, 3] == 0, :3], there[:, 3]
        best = told if len(told) else there[alpha == UNTOLD, :3]
        np.testing.assert_allclose(colors[n], best.mean(axis=0) / 255.0, atol=4 * 12 * 1e-3)


def test_what_they_learn(dataset):
    """Views that see the plate with a weight each: it becomes what fits them best."""
    learned = plates.learned_plates(dataset, "cpu")
    chosen = learned.reach()
    pixels = torch.from_numpy(chosen)
    rng = np.random.default_rng()
    left = torch.from_numpy(rng.uniform(0.2, 1.0, len(chosen))).float()
    target = torch.from_numpy(rng.uniform(size=(len(chosen), 3))).float()
    optimizer = torch.optim.LBFGS(learned.parameters(), max_iter=200, line_search_fn="strong_wolfe")

    def loss():
        optimizer.zero_grad()
        value = ((left[:, None] * learned(pixels)[0] - target) ** 2).sum()
        value.backward()
        return value

    optimizer.step(loss)
    found = learned(pixels)[0].detach().numpy().astype(np.float64)
    places = learned._places.numpy()
    weight, goal = left.numpy().astype(np.float64), target.numpy().astype(np.float64)
    for place in np.unique(places)[:20]:
        at = places == place
        expected = (weight[at, None] * goal[at]).sum(axis=0) / (weight[at] ** 2).sum()
        np.testing.assert_allclose(found[at][0], expected, atol=1e-3)


def test_only_untold_pixels_of_rings_take_memory(dataset):
    """The other pixels of all views may be hundreds of millions."""
    learned = plates.learned_plates(dataset, "cpu")
    untold = (dataset.pixels[:, 3] == UNTOLD).reshape(5, -1)
    untold[[1, 4]] = False
    np.testing.assert_array_equal(learned.reach(), np.flatnonzero(untold))
    held = [value for value in vars(learned).values() if isinstance(value, torch.Tensor)]
    assert all(len(value) <= untold.sum() for value in held)


def test_views_of_different_sizes_share_no_plate(dataset):
    """Nor do views without masks, or without a ring."""
    other = replace(dataset, lenses=(Lens(12, 16, (20.0, 20.0), (6.0, 8.0)), *dataset.lenses[1:]))
    assert plates.learned_plates(other, "cpu") is None
    assert plates.learned_plates(replace(dataset, rings=None), "cpu") is None
    assert plates.learned_plates(replace(dataset, rings=np.full(5, -1)), "cpu") is None
    assert plates.learned_plates(replace(dataset, masked=False), "cpu") is None
