"""The page about a capture: what it calls wrong, what it draws, and the command that writes it."""

import numpy as np
import pytest
from captures import circle
from PIL import Image

from deformrf.commands import train
from deformrf.core.training import (
    SparsePoints,
    gray_of,
    save_points,
    sharpness_of,
    sharpness_weights,
)
from deformrf.wings.capture import page, sphere


def shown(poses, sharpness=0.6, exposure=0.5):
    image = np.full((90, 120, 3), 120, np.uint8)
    return [page.Shown(f"{i:03d}.jpg", image, sharpness, exposure, p) for i, p in enumerate(poses)]


def changed(photo, **values):
    return page.Shown(**{**photo.__dict__, **values})


def test_photographs_that_stand_out_are_named_with_what_to_do():
    photos = shown(circle(20))
    photos[3] = changed(photos[3], sharpness=0.4)
    photos[7] = changed(photos[7], exposure=0.2)
    photos[9] = changed(photos[9], pose=None)
    judged = page.judge(photos)
    assert [i for i, words in enumerate(judged.faults) if words] == [3, 7, 9]
    told = "\n".join(judged.sentences(photos))
    for words in ("blurred: 003.jpg (hold", "dark: 007.jpg", "no camera: 009.jpg"):
        assert words in told
    assert "count less in training, down to 10%" in told
    assert page.words_about(judged.faults[3], judged.weights[3]) == "blurred (10%)"


def test_directions_without_a_camera_are_named_and_have_letters():
    whole = shown([*circle(24), *circle(12, radius=2.0, height=3.0)])
    judged = page.judge(whole)
    assert judged.gaps == [] and judged.sentences(whole) == []
    some = whole[:6] + whole[12:24]
    judged = page.judge(some)
    lines = judged.sentences(some)
    assert "(105° between 005.jpg and 012.jpg): take 6 more there" in lines[0]
    assert lines[1].endswith("show the top") and len(lines) == 2
    lettered = judged.sentences(some, with_letters=True)
    assert lettered == [f"A: {lines[0]}", f"B: {lines[1]}"]
    assert page.gaps_of([s.name for s in some], [s.pose for s in some]) == lines
    half = page.judge(shown(circle(8, end=2.0))).gaps[0].sentence
    assert "its back stays unknown" in half


def test_the_page_shows_cameras_points_box_and_all_photographs():
    photos = shown(circle(12))
    photos[2] = changed(photos[2], sharpness=0.1)
    points = np.random.default_rng().normal(size=(500, 3)) * 0.2
    colors = np.tile(np.array([[250, 0, 250]], np.uint8), (500, 1))
    ring = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    corners = np.array([(x, y, z) for z in (0, 1) for x, y in ring], float)
    drawn = np.asarray(page.page_of("a capture", photos, points, colors, corners)).reshape(-1, 3)
    counts = {c: (drawn == c).all(axis=1).sum() for c in (page.GREEN, page.RED, page.BLUE)}
    assert counts[page.GREEN] > 500 and counts[page.RED] > 300 and counts[page.BLUE] > 500
    assert (drawn == colors[0]).all(axis=1).sum() > 500
    assert (drawn == 120).all(axis=1).sum() >= 12 * 86 * 116  # a red frame covers the border
    colors = set(map(tuple, drawn))
    assert {sphere.SEEN, sphere.HARDLY, sphere.MISSED} <= colors
    assert page.page_of("no points", photos[:1], points[:0], points[:0]).width == page.WIDTH


def test_check_writes_a_page_and_trains_nothing(call, trainer, data, tmp_path):
    rng = np.random.default_rng()
    save_points(
        SparsePoints(
            rng.normal(size=(50, 3)).astype(np.float32),
            np.zeros((50, 3), np.uint8),
            np.full(50, 3, np.int32),
            np.zeros(50, np.float32),
        ),
        data,
    )
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--check")
    assert result.code == 0, result.err
    assert "m-check.png" in result.out and not trainer.calls
    with Image.open(tmp_path / "m-check.png") as image:
        assert image.width == page.WIDTH
    assert not (tmp_path / "m.npz").exists()


@pytest.mark.parametrize("shape", [(7, 900), (900, 7), (1, 1)])
def test_sharpness_of_images_of_any_shape_is_a_number(shape):
    image = np.random.default_rng().integers(0, 256, (*shape, 3)).astype(np.uint8)
    assert 0.0 <= sharpness_of(gray_of(image)) < 10.0


def test_sharp_photographs_count_whole_and_blurred_ones_by_their_detail():
    rng = np.random.default_rng()
    sharp = rng.normal(0.7, 0.02, 60).clip(0.67, 0.75)
    np.testing.assert_array_equal(sharpness_weights(sharp), 1.0)
    mixed = np.concatenate([sharp, [0.56, 0.5, 0.2]])
    weights = sharpness_weights(mixed)
    np.testing.assert_array_equal(weights[:60], 1.0)
    assert weights[60:].tolist() == pytest.approx([(0.06 / 0.2) ** 2, 0.1, 0.1], abs=0.03)
    # Many that are blurred don't hide one another.
    assert (sharpness_weights([*sharp, *[0.55] * 40]) < 1.0).sum() == 40
    assert len(sharpness_weights([])) == 0 and (sharpness_weights([0.0] * 9) == 1.0).all()


def test_a_camera_that_moved_is_told_whatever_its_direction():
    rng = np.random.default_rng()
    noise = rng.integers(0, 256, (120, 160, 3)).astype(np.uint8)
    photo = Image.fromarray(noise).resize((480, 360), Image.Resampling.BILINEAR)
    photo = np.asarray(photo.convert("L"), float)
    sharp = sharpness_of(photo.astype(np.uint8))
    for down, across in ((0, 1), (1, 0), (1, 1), (1, -1)):
        moved = [np.roll(photo, (k * down, k * across), (0, 1)) for k in range(8)]
        assert sharpness_of(np.mean(moved, axis=0).astype(np.uint8)) < 0.9 * sharp
