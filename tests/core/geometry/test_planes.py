"""Planes among points."""

import numpy as np

from deformrf.core.geometry import Plane, heaviest_plane


def test_the_plane_with_the_most_weight_is_found_to_its_thickness():
    rng = np.random.default_rng()
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    points = rng.uniform(-1.0, 1.0, (1000, 3))
    points[:500] -= ((points[:500] @ normal) - 0.3)[:, None] * normal
    plane = heaviest_plane(points, np.ones(1000), 0.01, rng)
    assert abs(plane.normal @ normal) > 0.999
    assert (abs(plane.height(points[:500])) < 0.01).all()


def test_the_other_side_of_a_plane_has_heights_of_the_other_sign():
    plane = Plane(np.array([0.0, 0.6, 0.8]), 0.25)
    points = np.random.default_rng().normal(size=(50, 3))
    np.testing.assert_array_equal(plane.turned().height(points), -plane.height(points))


def test_few_points_have_no_plane():
    rng = np.random.default_rng()
    assert heaviest_plane(rng.normal(size=(5, 3)), np.ones(5), 0.1, rng) is None
