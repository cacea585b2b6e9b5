"""Cameras on circles: the derivatives, and what a bundle adjustment with them recovers."""

from dataclasses import replace

import numpy as np
import pytest
from captures import turn_about_z

from deformrf.wings.capture import circles
from deformrf.wings.capture.still import Still

pytest.importorskip("pycolmap")


def random_rotation(rng):
    return circles.nearest_rotation(rng.normal(size=(3, 3)))


@pytest.fixture
def scene():
    """Two rings of nine photographs and one more, of 80 points, with all that is seen of them."""
    rng = np.random.default_rng()
    points = rng.uniform(-0.5, 0.5, (80, 3))
    ring = np.repeat([0, 1, 2], [9, 9, 1])
    # Before each camera, which looks along +z, at a distance of 3.
    left = np.array([circles.by_vector(rng.normal(size=(1, 3)))[0] for _ in range(3)])
    shift = np.array([0.0, 0.0, 3.0]) + rng.normal(scale=0.05, size=(3, 3))
    axis = np.array([np.eye(3), random_rotation(rng), random_rotation(rng)])
    b = rng.normal(scale=0.1, size=(3, 3)) * np.array([[0], [1], [1]])
    angle = np.concatenate([np.linspace(0, 5.5, 9), np.linspace(0.3, 6.0, 9), [0.0]])
    stand = np.repeat([1, 2, 0], [9, 9, 1])
    rings = circles.Rings(
        ring, stand, left, shift, axis, b, angle, np.array([400.0]), np.array([-0.05]), points
    )
    seen = everything(19, 80)
    return rings, replace(seen, pixels=circles.pixels_of(rings, seen))


def everything(camera_count, point_count):
    """All cameras see all points, with features of different scales; pixels are to be filled."""
    camera, point = (a.ravel() for a in np.indices((camera_count, point_count)))
    weights = np.random.default_rng().uniform(0.3, 2.0, len(camera))
    lens, center = np.zeros(camera_count, int), np.array([[240.0, 180.0]])
    return circles.Observed(camera, point, np.zeros((len(camera), 2)), weights, lens, center)


def test_the_formula_of_the_module(scene):
    rings, seen = scene
    for number in np.random.default_rng().choice(len(seen.cameras), 20):
        i, X = seen.cameras[number], rings.points[seen.points[number]]
        r, s = rings.ring[i], rings.stand[i]
        x = rings.A[s] @ X + rings.b[s]
        x = rings.L[r] @ turn_about_z(rings.angle[i]) @ x + rings.shift[r]
        q = x[:2] / x[2]
        expected = 400.0 * (1.0 - 0.05 * q @ q) * q + [240.0, 180.0]
        np.testing.assert_allclose(seen.pixels[number], expected, atol=1e-9)


def test_derivatives_are_those_of_small_changes(scene):
    rings, seen = scene
    rng = np.random.default_rng()
    total = 6 * (len(rings.L) + len(rings.A)) + len(rings.angle) + 2 * len(rings.focal)
    unknown, moved = 1e-6 * rng.normal(size=total), 1e-6 * rng.normal(size=rings.points.shape)
    step = np.concatenate([unknown, moved.ravel()])
    by_step = np.zeros_like(seen.pixels)
    for first, matrix in circles.blocks(rings, seen):
        columns = first[:, None] + np.arange(matrix.shape[2])
        by_step += np.einsum("nij,nj->ni", matrix, step[columns])
    unknown[18:24] = 0.0  # stand 0 is fixed, and nothing turns on it
    unknown[36:][: len(rings.angle)][rings.stand == 0] = 0.0
    ahead, behind = (
        circles.pixels_of(circles.changed(rings, sign * unknown, sign * moved), seen)
        for sign in (1.0, -1.0)
    )
    np.testing.assert_allclose(by_step, 0.5 * (ahead - behind), rtol=1e-4, atol=1e-9)


def test_free_cameras_with_errors_become_circles(scene):
    """What each photograph has alone is lost; what the ring has in common is found."""
    rings, seen = scene
    rng = np.random.default_rng()
    noisy = replace(seen, pixels=seen.pixels + rng.normal(scale=0.3, size=seen.pixels.shape))
    turns, shifts = rings.cameras()
    off = circles.by_vector(0.02 * rng.normal(size=(19, 3))) @ turns
    away = shifts + 0.05 * rng.normal(size=(19, 3))
    points = rings.points + 0.02 * rng.normal(size=(80, 3))
    first = circles.first_rings(
        [range(9), range(9, 18)], off, away, np.array([420.0]), np.zeros(1), points
    )
    found = circles.adjust(first, noisy)
    error = np.linalg.norm(circles.pixels_of(found, seen) - seen.pixels, axis=1)
    assert np.median(error) < 0.15  # of the pixels without noise, which has 0.35
    # The noise of 80 points and 19 views leaves f open by some pixels.
    assert abs(found.focal[0] - 400.0) < 40.0
    turns = found.cameras()[0]
    relative = turns[1:9] @ np.swapaxes(turns[:8], 1, 2)
    np.testing.assert_allclose(
        np.trace(relative, axis1=1, axis2=2), np.trace(relative[0]), atol=0.02
    )


def test_a_wrong_camera_of_a_ring_is_put_right(scene):
    rings, seen = scene
    turns, shifts = (a.copy() for a in rings.cameras())
    turns[4] = circles.by_vector(np.array([[0.0, 0.5, 0.2]]))[0] @ turns[4]
    shifts[4] += 1.0
    first = circles.first_rings(
        [range(9), range(9, 18)], turns, shifts, rings.focal, rings.k, rings.points
    )
    found = circles.adjust(first, seen)
    assert np.abs(circles.pixels_of(found, seen) - seen.pixels).max() < 1e-2


def test_few_photographs_stay_free():
    rings = circles.first_rings(
        [range(3)], np.tile(np.eye(3), (5, 1, 1)), np.ones((5, 3)), np.ones(1), np.zeros(1), None
    )
    assert len(rings.L) == 5


def before_a_room(stands, rng):
    """Two rings from afar, 15° and 40° above, what is seen of the object, and what stands still.

    Args:
        stands: The stand of the object in each ring, 1 or 2.
    """
    raised = np.radians([15.0, 40.0])
    L = circles.by_vector(np.stack([np.pi / 2.0 + raised, 0.0 * raised, 0.0 * raised], axis=1))
    shift = np.array([[0.0, 0.0, 8.0], [0.05, 0.02, 8.2]])
    A = np.array([np.eye(3), random_rotation(rng), random_rotation(rng)])
    b = np.array([[0.0, 0.0, 0.0], [0.1, -0.05, 0.1], [-0.1, 0.1, 0.0]])
    ring = np.repeat([0, 1], 9)
    angle = np.tile(np.linspace(0.0, 5.5, 9), 2)
    points = rng.uniform(-0.5, 0.5, (80, 3))
    lens = np.array([400.0]), np.array([-0.05])
    rings = circles.Rings(ring, np.array(stands)[ring], L, shift, A, b, angle, *lens, points)
    seen = everything(18, 80)
    turned = (seen.cameras + seen.points) % 9 < 3  # each point is seen from one side alone
    seen = replace(seen, cameras=seen.cameras[turned], points=seen.points[turned])
    noise = rng.normal(scale=0.3, size=(len(seen.cameras), 2))
    pixels, weights = circles.pixels_of(rings, seen) + noise, np.ones(len(noise))
    seen = replace(seen, pixels=pixels, weights=weights)
    room = replace(rings, ring=np.arange(2), stand=np.zeros(2, int), angle=np.zeros(2))
    room = replace(room, points=rng.uniform([-6, 1, -5], [6, 9, 5], (300, 3)))
    pixels = circles.pixels_of(room, everything(2, 300)).reshape(2, 300, 2).swapaxes(0, 1)
    pixels = pixels + rng.normal(scale=0.3, size=pixels.shape)
    return rings, seen, Still(np.tile([0, 1], (300, 1)), pixels, rng.uniform(1, 4, (300, 2)))


def joined(rings, seen, still):
    """Rings alone, and with the background, from cameras that are a little off."""
    groups = range(9), range(9, 18)
    free = *rings.cameras(), 1.03 * rings.focal, 0.0 * rings.k, rings.points
    alone = circles.adjust(circles.first_rings(groups, *free), seen)
    found = *alone.cameras(), alone.focal, alone.k, alone.points
    one = circles.adjust(circles.first_rings(groups, *found, one_stand=True), seen)
    both = circles.adjust(*circles.with_background(one, seen, still))
    return alone, circles.without_background(both, alone, seen)


def test_what_stands_still_tells_the_lens():
    """Median over five scenes, since noise decides in each."""
    off = []
    for seed in range(5):
        found = joined(*before_a_room((1, 1), np.random.default_rng(seed)))
        off.append([abs(rings.focal[0] - 400.0) for rings in found])
    alone, both = np.median(off, axis=0)
    assert both < 10.0
    assert both < 0.6 * alone


def test_an_object_that_was_set_anew_has_an_axis_in_each_ring():
    rings, seen, still = before_a_room((1, 2), np.random.default_rng())
    alone, both = joined(rings, seen, still)
    assert both is alone
    assert circles.error(alone, seen) < 0.5


def test_the_middle_between_two_rays():
    rng = np.random.default_rng()
    points, origins = rng.normal(size=(9, 3)), rng.normal(size=(9, 2, 3))
    directions = (points[:, None] - origins) * rng.uniform(0.5, 2.0, (9, 2, 1))
    directions[5:, 0] *= -1.0
    found, ahead = circles.nearest_to_rays(origins, directions)
    np.testing.assert_allclose(found, points, atol=1e-6)
    np.testing.assert_array_equal(ahead, np.arange(9) < 5)
