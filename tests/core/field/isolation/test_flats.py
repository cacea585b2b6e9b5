"""Flat parts of made-up solids."""

import numpy as np
from solids import any_of, ball, matter_where, slab

from deformrf.core.field.isolation.flats import flats_of


def test_a_floor_is_found_where_it_lies():
    matter = matter_where(slab((0, 0, 0.1), (1, 1, 0.17)), spacing=0.05)
    (flat, *_) = flats_of(matter)
    assert abs(flat.plane.normal[2]) > 0.999
    assert abs(abs(flat.plane.offset) - 0.135) < 0.5 * matter.edge
    assert abs(flat.area - 1.0) < 0.25
    inside, outside = np.array([[0.5, 0.5, 0.3]]), np.array([[1.5, 0.5, 0.1]])
    assert flat.covers(inside).all() and not flat.covers(outside).any()


def test_a_floor_and_a_wall_beside_a_ball_are_two():
    floor, wall = slab((0, 0, 0), (1, 1, 0.07)), slab((0, 0.93, 0), (1, 1, 1))
    matter = matter_where(any_of(floor, wall, ball((0.5, 0.5, 0.4), 0.2, 0.07)), spacing=0.05)
    normals = [abs(flat.plane.normal) for flat in flats_of(matter)]
    assert len(normals) == 2
    assert {int(normal.argmax()) for normal in normals} == {1, 2}
    assert all(normal.max() > 0.99 for normal in normals)


def test_fog_has_none():
    from dataclasses import replace

    matter = matter_where(slab((0, 0, 0), (1, 1, 0.1)), spacing=0.1)
    assert not flats_of(replace(matter, depths=np.full(len(matter.tets), 1e-6)))
