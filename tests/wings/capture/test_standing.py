"""Cameras that can't stand where mapping put them: of sets that are made up, at any scale."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from captures import circle, look

from deformrf.core.training import SparsePoints
from deformrf.core.training.data.points import SHAPES
from deformrf.wings.capture import CaptureError
from deformrf.wings.capture.mapping import Mapped
from deformrf.wings.capture.standing import LEAST_PLACES, POINTS, astray, checked, place_count, span

SCALES = 1e-3, 1.0, 1e4


def mapped(centers, seen, nearest=3.0, scale=1.0):
    """Cameras at centers [n, 3], each of which sees so many points from so far away."""
    count = len(centers)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, 3] = scale * np.asarray(centers)
    points = SparsePoints(*(np.zeros((0, *shape), kind) for shape, kind in SHAPES.values()))
    seen = np.broadcast_to(seen, count).copy()
    nearest = np.full(count, scale * nearest)
    numbers = np.arange(count)
    lenses = np.ones((count, 7))
    return Mapped(numbers, poses, lenses, points, seen, nearest, 0.4, (tuple(range(count)),))


def check(found, total=None):
    return checked(Path("photos"), total or len(found.numbers), found)


def around(count):
    return circle(count)[:, :3, 3]


def refused(found, match, total=None):
    with pytest.raises(CaptureError, match=match) as caught:
        check(found, total)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("count", [LEAST_PLACES, 16, 100])
def test_cameras_all_around_stand(scale, count):
    found = mapped(around(count), 60, scale=scale)
    assert (check(found).numbers == found.numbers).all()


@pytest.mark.parametrize("scale", SCALES)
def test_one_point_and_an_outlier_are_refused(scale):
    """Whatever they see: all but one are in one place."""
    rng = np.random.default_rng()
    centers = 1e-3 * rng.normal(size=(15, 3))
    centers[7] = 40.0
    refused(mapped(centers, 200, scale=scale), "stand in 1 place, .*too few .*: take 40")


@pytest.mark.parametrize("scale", SCALES)
def test_few_points_are_refused_and_an_outlier_among_many_is_left_out(scale):
    """Capture_toy's every fifth photograph: 15 cameras, one astray, 23 points in the median."""
    centers, seen = around(15), np.full(15, 23)
    centers[7], seen[7] = 400.0, 0
    refused(mapped(centers, seen, scale=scale), "median one sees 23 points .*few photographs: take")
    for away, points in ((400.0, 100), (3.0, 4)):
        centers, seen = around(15), np.full(15, 60)
        centers[7], seen[7] = away, points
        found = check(mapped(centers, seen, scale=scale))
        assert found.numbers.tolist() == [*range(7), *range(8, 15)]
        assert len(found.poses) == len(found.lenses) == len(found.seen) == len(found.nearest) == 14


def test_a_turntable_s_three_places_are_refused():
    rng = np.random.default_rng()
    centers = np.repeat(np.diag([5.0, 5.0, 5.0]), 24, axis=0) + 1e-3 * rng.normal(size=(72, 3))
    found = mapped(centers, 300, nearest=15.0)
    refused(found, "72 of 72 .* stand in 3 places, and 8 .*: take 40 .* walk around it")
    with pytest.raises(CaptureError) as caught:
        check(found)
    assert "too few" not in str(caught.value), "there are enough"


def test_what_a_video_walks_past_is_no_single_place():
    """Each frame is close to the last one, and all together see the object from many places."""
    centers = np.column_stack([np.linspace(0.0, 1.0, 100), np.zeros(100), np.zeros(100)])
    assert len(check(mapped(centers, 60)).numbers) == 100
    refused(mapped(0.05 * centers, 60), r"stand in \d places")


def test_an_overview_from_far_away_is_believed_if_it_sees_enough():
    centers = np.vstack([around(20), [[0.0, -30.0, 5.0]]])
    assert not astray(centers, np.full(21, 60)).any()
    assert astray(centers, np.array([60] * 20 + [POINTS // 2 - 1])).tolist() == [False] * 20 + [
        True
    ]


def test_places_are_counted_once():
    rng = np.random.default_rng()
    places = np.array([[x, y, 0.0] for x in range(3) for y in range(4)])
    many = np.repeat(places, 5, axis=0) + rng.uniform(-0.1, 0.1, (60, 3))
    assert place_count(rng.permutation(many), 0.4) == 12
    assert place_count(many, 0.0) == 60 and place_count(many, 100.0) == 1


@pytest.mark.parametrize("scale", SCALES)
def test_cameras_that_see_a_few_degrees_of_the_object_are_refused(scale):
    few = np.array([look((3 * np.sin(a), -3 * np.cos(a), 1.0)) for a in np.linspace(0, 0.14, 40)])
    for poses, stands in ((few.copy(), False), (circle(40), True)):
        poses[:, :3, 3] *= scale
        found = replace(mapped(around(40), 60), poses=poses, nearest=np.full(40, 3.0 * scale))
        if stands:
            assert len(check(found).numbers) == 40
        else:
            refused(found, r"40 of 40 .* see 7° of the object, and 10° are needed: take 40")
    astray_too = np.concatenate([few, circle(2)[1:]])
    assert span(astray_too, 1.0) < 15.0, "a single camera elsewhere tells nothing"


def test_the_span_has_a_closed_form():
    turned = np.linspace(-0.5, 0.5, 101)
    poses = np.array([look((3 * np.sin(a), -3 * np.cos(a), 0.0), (0, 0, 0)) for a in turned])
    assert span(poses, 1.0) == pytest.approx(0.9 * np.degrees(1.0), rel=1e-3)
    level = mapped(np.column_stack([np.linspace(-1, 1, 101), np.zeros((101, 2))]), 60).poses
    assert span(level, 4.0) == pytest.approx(2 * np.degrees(np.arctan(0.9 / 4.0)), rel=1e-3)
