"""Axes, planes and numbers that hold a drag."""

import math

import numpy as np
import pytest
from random_hands import random_axes, random_camera

from deformrf.viewer.camera import project, ray
from deformrf.viewer.document import rotation_matrix
from deformrf.viewer.tools import drags
from deformrf.viewer.tools.drags import Constraint, number_of, on_axis, on_plane, unwound


def test_numbers_are_what_python_takes_them_for_however_they_are_typed():
    random = np.random.default_rng()
    for _ in range(300):
        held = Constraint()
        for character in random.choice([*"0123456789.,-\bex"], random.integers(1, 30)):
            assert held.type(str(character)) == (character not in "ex")
            assert len(held.text) <= drags.LONGEST_NUMBER
            assert held.text.count(".") <= 1 and held.text.rfind("-") <= 0
            if held.text.strip("-."):
                assert held.number == float(held.text) and math.isfinite(held.number)
            else:
                assert held.number is None


@pytest.mark.parametrize(
    "text", ["", "-", ".", "-.", "nan", "inf", "-1e400", "1e400", "0x1", "one"]
)
def test_what_is_no_number_is_none(text):
    assert number_of(text) is None


def test_an_axis_is_models_then_its_own_then_none():
    held = Constraint(own=random_axes(np.random.default_rng()))
    held.choose(1)
    np.testing.assert_array_equal(held.along, [0.0, 1.0, 0.0])
    held.choose(1)
    np.testing.assert_array_equal(held.along, held.own[:, 1])
    held.choose(1)
    assert held.along is None
    held.choose(1)
    held.choose(2, across=True)
    assert (held.axis, held.across, held.is_own) == (2, True, False)
    assert held.words("move", 0.5) == "move along xy: 0.500 of the size"
    held.choose(2)
    held.choose(2)
    held.type("9")
    assert held.words("turn", 0.5) == "turn about its own z: 9_°"


def test_a_move_stays_on_its_axis_or_plane_as_near_to_the_mouse_as_it_can():
    random = np.random.default_rng()
    for _ in range(200):
        camera, _ = random_camera(random)
        start = random.uniform(0.3, 0.7, 3)
        held = Constraint(random_axes(random), int(random.integers(3)), is_own=True)
        held.across = bool(random.integers(2))
        (pixel,), _ = project(camera, (start + random.normal(scale=0.1, size=3))[None])
        place = held.place(camera, pixel, start, start, 1.0)
        along, way = held.along, place - start
        if held.across:
            assert abs(way @ along) < 1e-9
            assert (
                on_plane(ray(camera, pixel), start, along) is None
                or np.allclose(project(camera, place[None])[0][0], pixel, atol=1e-6)
                or np.linalg.norm(way) >= drags.FARTHEST_DRAG - 1e-9
            )
            continue
        np.testing.assert_allclose(way, (way @ along) * along, atol=1e-9)
        eye, direction = ray(camera, pixel)
        if on_axis((eye, direction), start, along) is not None:
            nearest = np.linalg.norm(np.cross(place - eye, direction))
            for step in (-1e-3, 1e-3):
                assert nearest <= np.linalg.norm(np.cross(place + step * along - eye, direction))


def test_a_length_that_is_typed_goes_along_the_axis_in_object_sizes():
    random = np.random.default_rng()
    camera, _ = random_camera(random)
    start, size = random.normal(size=3), 0.7
    held = Constraint(random_axes(random), 2, is_own=True)
    for character in "-.25":
        held.type(character)
    place = held.place(camera, np.zeros(2), start, start, size)
    np.testing.assert_allclose(place, start - 0.25 * size * held.own[:, 2])
    assert held.length(place - start, size) == pytest.approx(-0.25)
    for text, expected in (("99999", drags.FARTHEST_DRAG), ("", 0.0)):
        held.text = text
        if text:
            way = held.place(camera, np.zeros(2), start, start, size) - start
            assert np.linalg.norm(way) == pytest.approx(expected * size)


def test_a_turn_about_an_axis_follows_the_mouse_around_it():
    """A point of the plane across the axis is turned; the mouse is where it shows."""
    random, told = np.random.default_rng(), 0
    while told < 100:
        camera, ratio = random_camera(random)
        center, axes = random.uniform(0.4, 0.6, 3), random_axes(random)
        held = Constraint(axes, int(random.integers(3)), is_own=True)
        arm, angle = 0.3 * axes[:, (held.axis + 1) % 3], random.uniform(-3.0, 3.0)
        after = rotation_matrix(angle * held.along) @ arm
        ends, _ = project(camera, center + np.array([np.zeros(3), arm, after]))
        steep = [abs(ray(camera, pixel)[1] @ held.along) for pixel in ends]
        if min(steep) < 2.0 * drags.ALONG:
            continue
        if np.linalg.norm(ends[1] - ends[0]) < 2.0 * drags.NEAR * ratio:
            continue
        found = held.angle(camera, center, ends[1], ends[2], ratio, angle)
        assert found == pytest.approx(angle, abs=1e-6)
        told += 1


def test_an_angle_that_is_typed_is_in_degrees():
    random = np.random.default_rng()
    camera, ratio = random_camera(random)
    held = Constraint(axis=0)
    for character in "-90":
        held.type(character)
    anywhere = np.zeros(2)
    assert held.angle(camera, np.full(3, 0.5), anywhere, anywhere, ratio, 0.0) == -0.5 * np.pi
    np.testing.assert_array_equal(held.turn_axis(camera), [1.0, 0.0, 0.0])


def test_angles_go_on_over_whole_turns():
    for angle in np.linspace(-20.0, 20.0, 101):
        before = angle + 0.3
        found = unwound(before, math.sin(angle), math.cos(angle))
        assert found == pytest.approx(angle)
