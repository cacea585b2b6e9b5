"""Which flat parts go on beyond the object, and what goes with them."""

import numpy as np
from solids import any_of, ball, matter_where, slab

from deformrf.core.field.isolation.flats import flats_of
from deformrf.core.field.isolation.surroundings import (
    BORDER,
    NONE,
    STANDING,
    flat_parts_of,
    goes_on,
    layer_on,
    share_an_edge,
)

CUBE = np.array([[0.0] * 3, [1.0] * 3])
FLOOR = slab((0, 0, 0), (1, 1, 0.07))


def shell(low, high, wall=0.07):
    """The walls of a box."""
    outer, inner = slab(low, high), slab(np.add(low, wall), np.subtract(high, wall))
    return lambda points: outer(points) & ~inner(points)


def test_a_floor_goes_on_and_a_block_on_it_stands():
    block = shell((0.25, 0.25, 0.03), (0.75, 0.75, 0.6))
    flats = flats_of(matter_where(any_of(FLOOR, block), spacing=0.05))
    reasons = goes_on(flats, CUBE)
    upright = np.array([abs(flat.plane.normal[2]) < 0.1 for flat in flats])
    low = np.array([abs(flat.plane.offset) < 0.1 for flat in flats]) & ~upright
    assert (reasons[low] == BORDER).all() and low.sum() == 1
    assert (reasons[upright] == STANDING).all() and upright.sum() >= 3


def test_nothing_goes_on_of_a_box_in_the_air_and_its_sides_share_edges():
    flats = flats_of(matter_where(shell((0.2,) * 3, (0.8,) * 3), spacing=0.05))
    assert (goes_on(flats, CUBE) == NONE).all() and len(flats) >= 5
    one, two = flats[0], next(f for f in flats if abs(f.plane.normal @ flats[0].plane.normal) < 0.1)
    assert share_an_edge(one, two) and share_an_edge(two, one)


def test_a_cloth_on_the_floor_is_a_layer_and_a_ball_is_none():
    cloth, toy = slab((0.1, 0.1, 0.06), (0.35, 0.9, 0.1)), ball((0.65, 0.5, 0.3), 0.24)
    matter = matter_where(any_of(FLOOR, cloth, toy), spacing=0.05)
    floor = flat_parts_of(matter, CUBE, 0)[0]
    layer = layer_on(floor.flat, matter, floor.over, np.array([0.65, 0.5, 0.5]))
    gone = layer | floor.shell(matter)
    x, _, z = matter.middles.T
    assert gone[(x < 0.35) & (z < 0.1)].mean() > 0.9
    assert not gone[z > 0.2].any()
