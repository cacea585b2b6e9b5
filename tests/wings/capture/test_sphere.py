"""The picture of the sphere of directions: which color is where."""

import numpy as np
from captures import circle

from deformrf.wings.capture.directions import around, direction, elevations, gaps, lattice
from deformrf.wings.capture.sphere import (
    HARDLY,
    MISSED,
    SEEN,
    UNASKED,
    draw_disc,
    draw_sphere,
    letter,
    place_of,
    short,
)

R = 150


def color_at(disc, where):
    x, y = place_of(where, (R, R), R).astype(int)
    return tuple(np.asarray(disc)[y, x, :3])


def view_of(poses):
    return around([f"{n:03d}.jpg" for n in range(len(poses))], poses)


def luminance(color):
    return np.array(color) @ (0.2126, 0.7152, 0.0722)


def test_directions_have_the_color_of_the_nearest_photograph():
    view = view_of(circle(24))
    disc = draw_disc(view, R, 1.0)
    for seen in view.directions:
        assert color_at(disc, seen) == SEEN
    assert color_at(disc, direction(70.0, 52.0 + 10.0)) == HARDLY
    top = np.asarray(disc)[R - 12 : R + 12, R - 12 : R + 12, :3].reshape(-1, 3)
    assert {MISSED, tuple(c // 2 for c in MISSED)} <= set(map(tuple, top)), "striped"
    assert np.asarray(disc)[0, 0, 3] == 0 and np.asarray(disc)[R, R, 3] == 255
    below = draw_disc(view, R, -1.0)
    assert color_at(below, direction(70.0, -50.0)) == UNASKED


def test_a_place_in_a_disc_is_that_of_its_direction():
    np.testing.assert_allclose(place_of(np.array([0.0, -1.0, 0.0]), (R, R), R), (R, 2 * R))
    np.testing.assert_allclose(place_of(np.array([1.0, 0.0, 0.0]), (R, R), R), (2 * R, R))
    np.testing.assert_allclose(place_of(np.array([0.0, 0.0, 1.0]), (R, R), R), (R, R))
    away = np.linalg.norm(np.array([place_of(d, (0, 0), 90.0) for d in lattice()]), axis=1)
    np.testing.assert_allclose(away, 90.0 - np.abs(elevations(lattice())), atol=1e-6)


def test_colors_differ_in_lightness():
    bright, middle, dark = sorted(map(luminance, (SEEN, HARDLY, MISSED)), reverse=True)
    assert bright - middle > 25 and middle - dark > 60


def test_photographs_letters_and_a_legend_are_drawn_at_the_panel_s_size():
    for poses in (circle(24), circle(6), circle(8, end=2.0)):
        view = view_of(poses)
        image = draw_sphere(view, gaps(view), (493, 560))
        assert image.size == (493, 560)
        colors = set(map(tuple, np.asarray(image).reshape(-1, 3)))
        assert {SEEN, HARDLY, MISSED, UNASKED} <= colors
    plain = draw_sphere(view, [], (493, 560))
    assert np.any(np.asarray(plain) != np.asarray(image)), "letters of gaps"


def test_names_and_letters_are_short():
    assert [letter(n) for n in (0, 1, 26)] == ["A", "B", "A"]
    assert short("013.jpg") == "013" and short("none") == "none"
    assert short("IMG_20260101_123456.jpg") == "…0101_123456"
