"""What photographs see from where, and the sentences about what to take next."""

import numpy as np
import pytest
from captures import circle, look

from deformrf.wings.capture.directions import (
    COUNT,
    FAR,
    LEAST,
    angles_to_nearest,
    around,
    azimuths,
    direction,
    elevations,
    gaps,
    lattice,
    parts,
    side_of,
    up_of,
)


def ring(count, elevation, begin=0.0, end=360.0, radius=4.0):
    """Cameras at one height that look at the origin.  [count, 4, 4]"""
    turned = begin + (end - begin) * np.arange(count) / count
    return np.array([look(radius * direction(a, elevation), (0, 0, 0)) for a in turned])


def named(poses):
    return around([f"{n:03d}.jpg" for n in range(len(poses))], poses)


def told(*rings):
    return [gap.sentence for gap in gaps(named(np.concatenate(rings)))]


def turned(poses, angle):
    """The whole world about an axis that lies."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.eye(4)
    turn[:3, :3] = [(c, 0, s), (0, 1, 0), (-s, 0, c)]
    return turn @ poses


def test_the_first_photograph_is_in_front_and_its_right_is_right():
    for begin in (0.0, 77.0, -150.0):
        view = named(ring(8, 20.0, begin, begin + 360.0))
        flat = view.directions[[0, 2, 4, 6], :2] / np.cos(np.radians(20.0))
        np.testing.assert_allclose(flat, [(0, -1), (1, 0), (0, 1), (-1, 0)], atol=1e-9)
        np.testing.assert_allclose(view.turn @ view.turn.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(view.center, 0.0, atol=1e-9)
    sides = [side_of(a) for a in (-90.0, 0.0, 90.0, 180.0, -180.0, -135.0, 340.0)]
    assert sides == [
        "the front",
        "the right",
        "behind",
        "the left",
        "the left",
        "the front left",
        "the right",
    ]


def test_angles_to_the_nearest_have_a_closed_form():
    view = named(ring(12, 30.0))
    up = np.array([(0.0, 0.0, 1.0), direction(15.0, 30.0), view.directions[3]])
    between = np.degrees(np.arccos(0.25 + 0.75 * np.cos(np.radians(15.0))))
    found = angles_to_nearest(up, view.directions)
    np.testing.assert_allclose(found, [60.0, between, 0.0], atol=1e-5)
    where = direction(-33.0, 12.0)
    assert azimuths(where) == pytest.approx(-33.0) and elevations(where) == pytest.approx(12.0)


def test_who_looks_down_from_one_side_knows_up_all_the_same():
    """The mean up direction leans by 40° and less."""
    for end in (60.0, 120.0, 360.0):
        poses = turned(ring(12, 40.0, end=end), 25.0)
        up = turned(np.eye(4), 25.0)[:3, 2]
        assert up_of(poses) @ up == pytest.approx(1.0, abs=1e-9), end
        np.testing.assert_allclose(elevations(named(poses).directions), 40.0, atol=1e-6)
    narrow = ring(12, 40.0, end=5.0)  # the rows of all images lie along one direction
    assert up_of(narrow) @ narrow[0, :3, 1] > 0.999


def test_nothing_is_asked_for_where_nothing_is_missing():
    assert told(ring(24, 15.0), ring(16, 50.0)) == []
    assert told(ring(24, 46.0)) == []
    assert told(ring(12, -50.0), ring(24, 0.0), ring(12, 50.0)) == [], "it does not stand"


def test_a_step_around_that_is_wide_is_told_with_its_side_and_a_number():
    low, high = ring(24, 15.0), ring(24, 50.0)
    rows = np.r_[0:9, 15:24]
    poses = np.stack([low[rows], high[rows]], axis=1).reshape(-1, 4, 4)
    view = around([f"{n:03d}.jpg" for n in np.repeat(range(18), 2)], poses)
    (gap,) = gaps(view)
    assert gap.sentence == (
        "no photograph is taken from behind (105° between 008.jpg and 009.jpg): take 6 more there"
    )
    assert gap.names == ("008.jpg", "009.jpg") and gap.middle[1] > 0.6
    (sentence,) = told(low[:10], high[:10])
    assert sentence.startswith("the cameras see 135° of the object: its back stays unknown; if")
    assert sentence.endswith("take 14 more on the way from 009.jpg to 000.jpg")


@pytest.mark.parametrize(
    ("height", "rings"),
    [(6.0, "rings at 35° and 60°, of some 12 photographs each"), (32.0, "a ring at 60°, of some")],
)
def test_a_top_that_no_photograph_shows_is_told_with_rings_that_join(height, rings):
    (sentence,) = told(ring(24, height))
    assert sentence.startswith(f"no photograph is taken from more than {height:.0f}° above level")
    assert rings in sentence and sentence.endswith("show the top")


def test_an_underside_is_asked_for_if_some_photographs_are_from_below():
    assert told(ring(24, 46.0), ring(2, -10.0, 40.0, 80.0)) == [], "on a table"
    (sentence,) = told(ring(24, 10.0), ring(16, 50.0), ring(24, -30.0))
    assert "more than 30° below level: take a ring at 60°" in sentence
    assert sentence.endswith("show the underside")


def test_holes_are_told_with_a_side_a_height_and_the_nearest_photograph():
    high = ring(24, 60.0)
    (sides,) = told(high)
    assert (
        sides == "no photograph is taken from less than 60° above level: take a ring of them at 5°"
    )
    (hole,) = gaps(named(np.concatenate([high, ring(12, 10.0, -100.0, 100.0)])))
    assert hole.sentence.startswith("no photograph is taken from behind, 10° above level (the n")
    assert hole.names[0] in hole.sentence and "take" in hole.sentence
    view = named(np.concatenate([high, ring(12, 10.0, -100.0, 100.0)]))
    assert angles_to_nearest(hole.middle, view.directions) > FAR


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_neither_scale_nor_place_nor_the_order_of_photographs_matters(scale):
    poses = circle(9)
    poses[:, :3, 3] = scale * poses[:, :3, 3] + 7.0
    assert [g.sentence for g in gaps(named(poses))] == told(circle(9))
    mixed = np.r_[0, 1 + np.random.default_rng().permutation(8)]
    view = around([f"{n:03d}.jpg" for n in mixed], poses[mixed])
    assert sorted(g.sentence for g in gaps(view)) == sorted(told(circle(9)))


def test_cameras_that_look_at_no_common_point_say_nothing():
    parallel = np.tile(np.eye(4), (8, 1, 1))
    parallel[:, 0, 3] = np.arange(8)
    assert named(parallel) is None and named(circle(1)) is None and named(circle(1)[:0]) is None
    outwards = circle(12) * np.array([-1.0, 1.0, -1.0, 1.0])
    assert named(outwards) is None
    above = np.array([look((0.3 * n - 1.0, 0.2 * (n % 3), 4.0), (0, 0, 0)) for n in range(8)])
    assert named(above) is not None
    assert all(isinstance(gap.sentence, str) for gap in gaps(named(above)))


def test_the_lattice_is_even_and_its_regions_hang_together():
    asked = lattice()
    np.testing.assert_allclose(np.linalg.norm(asked, axis=1), 1.0)
    near = np.sort(asked @ asked.T, axis=1)[:, -2]
    assert (np.degrees(np.arccos(near)) < 5.0).all()
    caps = (asked[:, 2] > 0.9) | (asked[:, 0] > 0.95)
    one, other = parts(asked, caps)
    assert (one[:, 2] > 0.9).all() and (other[:, 0] > 0.95).all()
    assert len(one) / COUNT == pytest.approx(0.05, abs=0.003) and len(other) > LEAST * COUNT
    assert parts(asked, np.zeros(COUNT, bool)) == []
