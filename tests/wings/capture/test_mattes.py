"""What turns before a still background, told by the photographs alone."""

import numpy as np
import pytest

from deformrf.wings.capture import mattes
from deformrf.wings.capture.mattes import BACKGROUND, OBJECT, UNKNOWN

SHAPE = (60, 80)


@pytest.fixture
def ring():
    """A square that moves over a pattern: photographs, where it is, the pattern."""
    rng = np.random.default_rng()
    pattern = np.repeat(np.repeat(rng.integers(60, 200, (6, 8, 3)), 10, axis=0), 10, axis=1)
    images, places = [], []
    for number in range(16):
        place = np.zeros(SHAPE, bool)
        place[20:40, 4 * number + 2 : 4 * number + 14] = True
        image = np.where(place[..., None], [250, 20, 30], pattern)
        images.append(np.clip(image + rng.normal(scale=1.0, size=image.shape), 0, 255))
        places.append(place)
    return np.array(images).astype(np.uint8), np.array(places), pattern


def test_the_background_is_what_most_photographs_show(ring):
    images, _, pattern = ring
    found = mattes.background_of(images)
    assert found.known.all()
    assert np.abs(found.color - pattern).max() < 3.0


def test_mattes_are_where_the_object_is(ring):
    images, places, _ = ring
    background = mattes.background_of(images)
    for image, place in zip(images, places, strict=True):
        matte = mattes.matte_of(image, background)
        assert ((matte > UNKNOWN) != place).mean() < 0.005
        assert (matte[place] == OBJECT).mean() > 0.8


def test_exposure_and_white_balance_may_drift(ring):
    images, places, _ = ring
    gains = np.random.default_rng().uniform(0.8, 1.2, (len(images), 1, 1, 3))
    drifted = np.clip(images * gains, 0, 255).astype(np.uint8)
    background = mattes.background_of(drifted)
    for image, place in zip(drifted, places, strict=True):
        assert ((mattes.matte_of(image, background) > UNKNOWN) != place).mean() < 0.02


def test_a_shadow_is_left_open_and_another_color_is_not(ring):
    images, _, pattern = ring
    background = mattes.background_of(images)
    image = pattern.astype(float)
    image[5:15, 5:15] *= 0.7
    image[45:55, 45:55] = 255 - image[45:55, 45:55]
    matte = mattes.matte_of(image.astype(np.uint8), background)
    assert (matte[6:14, 6:14] == UNKNOWN).all()
    assert (matte[46:54, 46:54] > UNKNOWN).mean() > 0.9
    assert (matte[0:4] == BACKGROUND).all()


def test_what_is_always_covered_is_not_known(ring):
    images = ring[0].copy()
    rng = np.random.default_rng()
    images[:, 25:35, 30:50] = rng.integers(0, 256, images[:, 25:35, 30:50].shape)
    background = mattes.background_of(images)
    assert not background.known[27:33, 32:48].any()
    assert (mattes.matte_of(images[0], background)[27:33, 32:48] == UNKNOWN).all()


def test_an_island_of_one_color_is_not_background():
    """The middle of a plain object that turns looks the same in each photograph."""
    rng = np.random.default_rng()
    images = np.full((12, *SHAPE, 3), 120)
    noise = rng.integers(0, 256, (12, 40, 60, 3))
    images[:, 10:50, 10:70] = noise
    images[:, 25:35, 30:50] = 200
    background = mattes.background_of(images.astype(np.uint8))
    assert background.known[:9].all()
    assert not background.known[26:34, 31:49].any()


def test_a_pixel_at_the_edge_is_the_objects_in_part():
    color = np.full((*SHAPE, 3), 100.0, np.float32)
    image = color.copy()
    image[20:40, 20:40] = 200.0
    image[20:40, 40] = 125.0  # a quarter of it
    background = mattes.Background(color, np.ones(SHAPE, bool), 12.0)
    matte = mattes.matte_of(image.astype(np.uint8), background)
    share = (matte[25:35, 40].astype(float) - UNKNOWN) / (OBJECT - UNKNOWN)
    assert np.abs(share - 0.25).max() < 0.05


def test_ring_by_ring(ring):
    images, places, _ = ring
    numbers, done = [3, 5, 7, 8, 9, 11, 12], []
    found = dict(mattes.mattes_of(lambda n: images[n], numbers, done.append))
    assert list(found) == numbers
    assert done == list(range(1, 8))
    assert ((found[8] > UNKNOWN) != places[8]).mean() < 0.05
