"""Where an object is solid, and the middle of it under the mouse."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.field import FieldOptions, pack_mask, random_field, subtet_middles
from deformrf.core.geometry import a15_grid, tet_neighbours
from deformrf.viewer.document import Matter


@pytest.fixture(scope="module")
def grid_field():
    mesh = a15_grid(1 / 14)
    return random_field(mesh, tet_neighbours(mesh.tets), FieldOptions(2, 2**8, (16,), (16,)))


def filled(field, inside):
    """The field, whose matter is where a function of places [N, 3] says."""
    middles = subtet_middles(field.mesh)
    occupied = inside(middles.reshape(-1, 3)).reshape(middles.shape[:2])
    return Matter(replace(field, occupancy=pack_mask(occupied)))


@pytest.fixture(scope="module")
def shell(grid_field):
    """A hollow ball: training has dropped its inside, which no photograph shows."""

    def inside(places):
        away = np.linalg.norm(places - 0.5, axis=1)
        return (away < 0.4) & (away > 0.3)

    return filled(grid_field, inside)


@pytest.fixture(scope="module")
def legs(grid_field):
    """Two pillars with air between them."""

    def inside(places):
        left = np.hypot(places[:, 0] - 0.25, places[:, 1] - 0.5) < 0.12
        return left | (np.hypot(places[:, 0] - 0.75, places[:, 1] - 0.5) < 0.12)

    return filled(grid_field, inside)


def test_a_closed_shell_is_solid_to_its_middle(shell):
    random = np.random.default_rng()
    way = random.normal(size=(200, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    assert shell.holds(0.5 + way * random.uniform(0.0, 0.36, (200, 1))).all()
    assert not shell.holds(0.5 + 0.47 * way).any()


def test_a_ray_through_a_ball_finds_its_middle(shell):
    for way in ([1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.6, 0.0, 0.8]):
        way = np.array(way)
        place, depth = shell.middle(0.5 - 2.0 * way, way, 1.6)
        assert place == pytest.approx([0.5, 0.5, 0.5], abs=0.02)
        assert depth == pytest.approx(0.8, abs=0.04)


def test_air_between_two_legs_parts_them(legs):
    along = np.array([1.0, 0.0, 0.0])
    place, depth = legs.middle(np.array([-1.0, 0.5, 0.5]), along, 1.13)
    assert place == pytest.approx([0.25, 0.5, 0.5], abs=0.02)
    assert depth == pytest.approx(0.24, abs=0.04)


def test_the_leg_behind_is_found_where_it_is_seen(legs):
    away = np.array([0.0, 1.0, 0.0])
    place, _ = legs.middle(np.array([0.75, -1.0, 0.3]), away, 1.38)
    assert place == pytest.approx([0.75, 0.5, 0.3], abs=0.02)


def test_a_ray_beside_the_object_finds_nothing(legs):
    assert legs.middle(np.array([0.5, -1.0, 0.5]), np.array([0.0, 1.0, 0.0]), 1.5) is None
