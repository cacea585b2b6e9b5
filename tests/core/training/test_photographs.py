"""What is drawn from photographs: what their masks tell, and what has a plate behind it."""

from dataclasses import replace

import numpy as np
import pytest
from image_datasets import from_images

from deformrf.core.render import Lens, look_at
from deformrf.core.training import UNTOLD, preset
from deformrf.core.training.photographs import photographed_rays
from deformrf.core.training.run.plates import learned_plates, untold_pixels

LENS = Lens(16, 12, (20.0, 20.0), (8.0, 6.0))


@pytest.fixture
def dataset():
    """Four masked photographs of random pixels, some of them untold."""
    rng = np.random.default_rng()
    images = rng.integers(2, 256, (4, 12, 16, 4)).astype(np.uint8)
    images[..., 3] = np.where(rng.random((4, 12, 16)) < 0.2, UNTOLD, images[..., 3])
    poses = [look_at(rng.normal(size=3) + np.eye(3)[0] * 3.0, np.zeros(3)) for _ in range(4)]
    return replace(from_images(list(images), poses, [LENS] * 4, "abcd", "train"), masked=True)


def test_untold_pixels_are_not_drawn(dataset):
    options = replace(preset("tiny"), leave_out=("blur-weights",))
    bank = photographed_rays(dataset, options, np.eye(4), "cpu", None, None, print)
    told = np.flatnonzero(dataset.pixels[:, 3] != UNTOLD)
    np.testing.assert_array_equal(bank.bank.pool.numpy(), told)


def test_before_a_plate_they_are(dataset):
    """Views 1 and 3 are a ring; the untold pixels of the others stay out."""
    options = replace(preset("tiny"), leave_out=("blur-weights",))
    dataset = replace(dataset, rings=np.array([-1, 0, -1, 0]))
    plates = learned_plates(dataset, "cpu")
    bank = photographed_rays(dataset, options, np.eye(4), "cpu", None, plates, print)
    told = (dataset.pixels[:, 3] != UNTOLD).reshape(4, -1)
    told[[1, 3]] = True
    np.testing.assert_array_equal(bank.bank.pool.numpy(), np.flatnonzero(told))


def test_alpha_that_no_mask_says_is_always_told(dataset):
    """An image may have an alpha of 1 of its own."""
    assert untold_pixels(replace(dataset, masked=False)) is None
    dataset.pixels[:, 3] = 255
    assert untold_pixels(dataset) is None
