"""Angles between scored views and those of the training, in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from captures import look
from image_datasets import from_images

from deformrf.core.render import in_space, pinhole, rows_of_views
from deformrf.core.training import angles_told
from deformrf.core.training.data.sector import sector_of
from deformrf.core.training.nearness import Nearness, median_and_largest

LENS = pinhole(20.0, 16, 16)


def places(azimuths, elevation=0.0):
    a, e = np.radians(azimuths), np.radians(elevation)
    flat = 4.0 * np.cos(e) * np.stack([np.cos(a), np.sin(a)], axis=-1)
    return np.array([look((x, y, 4.0 * np.sin(e)), (0, 0, 0)) for x, y in flat])


def views(poses):
    images = [np.zeros((16, 16, 4), np.uint8)] * len(poses)
    return from_images(images, poses, [LENS] * len(poses), ["a"] * len(poses), "test")


def trained_on(field, poses, **meta):
    """The field with these training views, in a world that is turned, scaled and shifted."""
    place = np.eye(4)
    place[:3, :3] = np.array([(0, 0, 1), (1, 0, 0), (0, 1, 0)]) / 3.0
    place[:3, 3] = 0.4, 0.5, 0.6
    rows = rows_of_views(in_space(poses, place), [LENS] * len(poses))
    return replace(field, world_to_model=place, meta={"views": rows, **meta})


def test_angles_are_those_around_the_point_that_training_views_look_at(field):
    trained = trained_on(field, places(np.arange(0.0, 360.0, 30.0)))
    asked = np.concatenate([places([0.0, 40.0, 345.0]), places([60.0], 25.0)])
    nearness = Nearness.of(trained, views(asked))
    np.testing.assert_allclose(nearness.angles, [0.0, 10.0, 15.0, 25.0], atol=0.02)
    assert nearness.inside is None and nearness.of_view(3) == {"angle": nearness.angles[3]}


def test_what_is_held_out_is_known_to_be_inside(field):
    poses = places(np.arange(0.0, 360.0, 15.0))
    sector = sector_of([str(i) for i in range(24)], poses)
    assert sector.views == ("0", "1", "2", "3")
    trained = trained_on(field, poses[4:], **sector.as_report())
    nearness = Nearness.of(trained, views(places([0.0, 22.5, 45.0, 50.0, 70.0])))
    np.testing.assert_allclose(nearness.angles, [15.0, 37.5, 15.0, 10.0, 5.0], atol=0.02)
    assert nearness.inside == [True, True, True, True, False]
    assert nearness.of_view(4)["in_sector"] is False


@pytest.mark.parametrize("rows", [None, [], "parallel"])
def test_without_training_views_around_a_point_there_are_no_angles(field, rows):
    if rows == "parallel":
        rows = rows_of_views(np.tile(np.eye(4), (3, 1, 1)), [LENS] * 3)
    nearness = Nearness.of(replace(field, meta={"views": rows}), views(places([0.0])))
    assert nearness.angles is None and nearness.of_view(0) == {"angle": None}


@pytest.mark.parametrize("kind", ["no camera", "left out"])
def test_where_the_model_does_not_keep_all_views_there_are_no_angles(field, kind):
    trained = trained_on(field, places(np.arange(0.0, 360.0, 30.0)))
    rows = [list(row) for row in trained.meta["views"]]
    meta = {"views": rows, "view_count": 12}
    if kind == "no camera":
        rows[0][0] += 1.0
        del meta["view_count"]
    else:
        del rows[0]
    assert Nearness.of(replace(field, meta=meta), views(places([0.0]))).angles is None


def test_angles_are_told():
    told = "4.0° from the nearest training view (median; at most 9.0°)"
    assert angles_told({"median": 4.0, "largest": 9.0}) == told and angles_told(None) == ""


def test_median_and_largest():
    assert median_and_largest([3.0, 9.0, 4.0]) == {"median": 4.0, "largest": 9.0}
    assert median_and_largest([]) is median_and_largest([1.0, None]) is None
