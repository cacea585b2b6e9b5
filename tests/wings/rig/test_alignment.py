"""A rig is laid on a model: turned, scaled, moved, with specks and noise."""

import numpy as np
import pytest

from deformrf.wings.rig import align, outer_points, rotations, shared_space


def body(rng, count):
    """Points on three ellipsoids: no turn but the identity maps them onto themselves."""
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    which = rng.integers(0, 3, count)
    sizes = np.array([[1.0, 0.4, 0.3], [0.2, 0.2, 0.5], [0.3, 0.15, 0.15]])
    middles = np.array([[0.0, 0.0, 0.0], [0.8, 0.1, 0.6], [-0.9, 0.1, 0.4]])
    return sizes[which] * directions + middles[which]


@pytest.mark.parametrize("yaw", [0.0, 90.0, 200.0])
def test_a_turned_body_is_found(yaw):
    rng = np.random.default_rng()
    source, matter = body(rng, 3000), body(rng, 3000) + rng.normal(0.0, 0.01, (3000, 3))
    matrix = np.eye(4)
    turn = rotations.of_vector([0.0, 0.0, np.radians(yaw)])
    matrix[:3, :3] = 0.3 * rotations.matrix_of(turn)
    matrix[:3, 3] = [0.5, 0.4, 0.6]
    matter = matter @ matrix[:3, :3].T + matrix[:3, 3]
    specks = rng.uniform(0.0, 1.0, (3, 3))
    found = align(source, np.concatenate([matter, specks]))
    error = (source @ (found - matrix)[:3, :3].T) + (found - matrix)[:3, 3]
    size = np.linalg.norm(np.ptp(matter, axis=0))
    assert np.linalg.norm(error, axis=1).max() < 0.02 * size


def test_surface_points_of_a_solid():
    rng = np.random.default_rng()
    places = rng.uniform(-1.0, 1.0, (40000, 3))
    places = places[np.linalg.norm(places, axis=1) < 1.0]
    outer = np.linalg.norm(outer_points(places, 0.15), axis=1)
    assert outer.min() > 0.6 and len(outer) > 0.15 * len(places)


def test_what_has_no_size_is_said_so():
    with pytest.raises(ValueError, match="has no size"):
        align(np.zeros((5, 3)), np.zeros((0, 3)))


def sphere(rng, radius=1.0, count=8000):
    directions = rng.normal(size=(count, 3))
    return radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_bodies_share_what_lies_in_both():
    rng = np.random.default_rng()
    outer, same, inner = sphere(rng), sphere(rng), sphere(rng, 0.8)
    assert shared_space(outer, same) > 0.95
    assert shared_space(inner, outer) == pytest.approx(0.8**3, abs=0.06)
    d = 1.0  # two unit spheres so far apart share a lens of this part of their union
    lens = (2.0 - d) ** 2 * (d * d + 4.0 * d) / (16.0 * d)
    moved = shared_space(outer + np.array([d, 0.0, 0.0]), same)
    assert moved == pytest.approx(lens / (2.0 - lens), abs=0.05)
    assert shared_space(outer + 9.0, same) == 0.0


def test_points_inside_a_body_and_a_gap_in_its_surface_change_nothing():
    rng = np.random.default_rng()
    outer, full = sphere(rng), sphere(rng, 1.0, 20000) * rng.uniform(size=(20000, 1)) ** (1 / 3)
    slit = outer[np.abs(outer[:, 2]) > 0.02]
    assert shared_space(slit, full) > 0.9
