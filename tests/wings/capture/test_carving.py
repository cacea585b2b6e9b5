"""Space carving by votes: a ball, seen by cameras around it."""

from dataclasses import replace

import numpy as np
import pytest
from captures import look

from deformrf.wings.capture import carving
from deformrf.wings.capture.mattes import BACKGROUND, OBJECT, UNKNOWN

RADIUS, WIDTH, HEIGHT, FOCAL = 0.5, 160, 120, 150.0
LENS = np.array([FOCAL, FOCAL, 80.0, 60.0, 0.0, WIDTH, HEIGHT])


def ball_of(pose):
    """The pixels whose rays meet the ball.  [HEIGHT, WIDTH] bool"""
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = np.stack([(columns - 80) / FOCAL, (60 - rows) / FOCAL, -np.ones_like(rows)], axis=-1)
    rays = rays @ pose[:3, :3].T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    along = -rays @ pose[:3, 3]
    return pose[:3, 3] @ pose[:3, 3] - along**2 < RADIUS**2


@pytest.fixture
def views():
    rng = np.random.default_rng()
    found = []
    for place in rng.normal(size=(40, 3)):
        pose = look(2.5 * place / np.linalg.norm(place), (0.0, 0.0, 0.0))
        matte = np.where(ball_of(pose), OBJECT, BACKGROUND).astype(np.uint8)
        found.append(carving.View(pose, LENS, matte))
    return found


@pytest.fixture
def points():
    places = np.random.default_rng().normal(size=(400, 3))
    return RADIUS * places / np.linalg.norm(places, axis=1, keepdims=True)


def iou(one, other):
    return (one & other).sum() / (one | other).sum()


def test_the_hull_of_a_ball_is_a_ball(views, points):
    hull = carving.carve(views, points)
    radii = np.linalg.norm(hull.shell, axis=1)
    assert abs(np.median(radii) - RADIUS) < 2 * hull.edge
    assert radii.max() < RADIUS + 6 * hull.edge
    assert radii.min() > RADIUS - 2 * hull.edge
    np.testing.assert_allclose(hull.box, [[-RADIUS] * 3, [RADIUS] * 3], atol=3 * hull.edge)
    for view in views[:4]:
        assert iou(carving.voted(view, hull) > 127, view.matte == OBJECT) > 0.97


def test_votes_mend_single_mattes(views, points):
    """A shadow that one view calls the object, a bite that one lacks, a view that knows nothing."""
    rng = np.random.default_rng()
    wrong = []
    for number, view in enumerate(views):
        matte = view.matte.copy()
        if number % 4 == 0:
            row, column = rng.integers(0, 100), rng.integers(0, 140)
            matte[row : row + 20, column : column + 20] = rng.choice([UNKNOWN, OBJECT])
        if number % 4 == 1:
            matte[50:70, 70:90] = UNKNOWN
        if number % 10 == 2:
            matte[55:60, 75:80] = BACKGROUND
        wrong.append(carving.View(view.pose, view.lens, matte))
    hull = carving.carve(wrong, points)
    for view, bad in zip(views, wrong, strict=True):
        assert iou(carving.voted(bad, hull) > 127, view.matte == OBJECT) > 0.93
    blind = carving.View(views[0].pose, LENS, None)
    assert iou(carving.voted(blind, hull) > 127, views[0].matte == OBJECT) > 0.9


def test_a_hole_in_all_mattes_stays_one(views, points):
    """Two balls, one above the other: what is between them is seen by all."""
    shifted = []
    for view in views:
        both = np.zeros((HEIGHT, WIDTH), bool)
        for z in (-0.6, 0.6):
            moved = view.pose.copy()
            moved[2, 3] -= z
            both |= ball_of(moved)
        matte = np.where(both, OBJECT, BACKGROUND).astype(np.uint8)
        shifted.append(carving.View(view.pose, LENS, matte))
    doubled = np.concatenate([points + np.array([0, 0, 0.6]), points - np.array([0, 0, 0.6])])
    hull = carving.carve(shifted, doubled)
    between = np.abs(hull.shell[:, 2]) < 0.05
    assert not (between & (np.linalg.norm(hull.shell[:, :2], axis=1) < 0.4)).any()


def test_nothing_is_left_where_all_is_background(views, points):
    empty = [carving.View(v.pose, v.lens, np.zeros_like(v.matte)) for v in views]
    assert carving.carve(empty, points) is None


def test_pixels_are_those_of_the_lens():
    rng = np.random.default_rng()
    lens = np.array([150.0, 140.0, 75.0, 62.0, -0.1, WIDTH, HEIGHT])
    pose = look(rng.normal(size=3) + np.array([0, -3, 0]), (0, 0, 0))
    points = rng.uniform(-0.3, 0.3, (50, 3)).astype(np.float32)
    columns, rows, there = carving.pixels_of(carving.View(pose, lens, None), points)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    q = np.array([1.0, -1.0]) * local[:, :2] / -local[:, 2:]
    q *= 1.0 - 0.1 * (q**2).sum(axis=1, keepdims=True)
    expected = q * lens[:2] + lens[2:4]
    inside = (expected >= 0).all(axis=1) & (expected < [WIDTH, HEIGHT]).all(axis=1)
    np.testing.assert_array_equal(there, inside)
    off = np.stack([columns, rows], axis=1)[inside] + 0.5 - expected[inside]
    assert np.abs(off).max() <= 0.501


def test_mattes_that_contradict_the_others_have_no_vote(views, points):
    """One in five shows nothing, all, something else, or half of the ball."""
    wrong = []
    for number, view in enumerate(views):
        matte = view.matte.copy()
        kind = "empty full other half unknown".split()[number // 5 % 5] if number % 5 == 0 else ""
        if kind == "half":
            matte[:60] = BACKGROUND
        elif kind:
            matte[:] = {"full": OBJECT, "unknown": UNKNOWN}.get(kind, BACKGROUND)
        if kind == "other":
            matte[:40, :60] = OBJECT
        wrong.append(replace(view, matte=matte))
    assert carving.agreeing(wrong, points).tolist() == [n % 5 > 0 for n in range(len(views))]
    assert not carving.agreeing(wrong[:1], points).any(), "nothing is left of an empty matte"
