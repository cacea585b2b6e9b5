"""Cameras on circles: the derivatives, and what a bundle adjustment with them recovers."""

from dataclasses import replace

import numpy as np
import pytest
from captures import turn_about_z

from deformrf.wings.capture import circles

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
    axis = np.array([random_rotation(rng), random_rotation(rng), np.eye(3)])
    b = rng.normal(scale=0.1, size=(3, 3)) * np.array([[1], [1], [0]])
    angle = np.concatenate([np.linspace(0, 5.5, 9), np.linspace(0.3, 6.0, 9), [0.0]])
    rings = circles.Rings(
        ring, left, shift, axis, b, angle, np.array([400.0]), np.array([-0.05]), points
    )
    camera, point = (a.ravel() for a in np.indices((19, 80)))
    seen = circles.Observed(
        camera, point, np.zeros((len(camera), 2)), np.zeros(19, int), np.array([[240.0, 180.0]])
    )
    return rings, replace(seen, pixels=circles.pixels_of(rings, seen))


def test_the_formula_of_the_module(scene):
    rings, seen = scene
    for number in np.random.default_rng().choice(len(seen.cameras), 20):
        i, X = seen.cameras[number], rings.points[seen.points[number]]
        r = rings.ring[i]
        x = rings.A[r] @ X + rings.b[r]
        x = rings.L[r] @ turn_about_z(rings.angle[i]) @ x + rings.shift[r]
        q = x[:2] / x[2]
        expected = 400.0 * (1.0 - 0.05 * q @ q) * q + [240.0, 180.0]
        np.testing.assert_allclose(seen.pixels[number], expected, atol=1e-9)


def test_derivatives_are_those_of_small_changes(scene):
    rings, seen = scene
    rng = np.random.default_rng()
    total = 12 * len(rings.L) + len(rings.angle) + 2 * len(rings.focal)
    unknown, moved = 1e-6 * rng.normal(size=total), 1e-6 * rng.normal(size=rings.points.shape)
    step = np.concatenate([unknown, moved.ravel()])
    by_step = np.zeros_like(seen.pixels)
    for first, matrix in circles.blocks(rings, seen):
        columns = first[:, None] + np.arange(matrix.shape[2])
        by_step += np.einsum("nij,nj->ni", matrix, step[columns])
    alone = np.bincount(rings.ring) == 1  # neither axis nor angle
    unknown[: 12 * len(alone)].reshape(-1, 4, 3)[alone, 2:] = 0.0
    unknown[12 * len(alone) :][: len(rings.angle)][alone[rings.ring]] = 0.0
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
