"""What a click and strokes single out of made-up solids, for which the answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from solids import any_of, ball, matter_where, slab

from deformrf.core.field import (
    Isolation,
    Stroke,
    isolated,
    isolation_of,
    kept_field,
    left_out_in_words,
    without_flats,
)
from deformrf.core.field.isolation import isolating
from deformrf.core.field.isolation.isolating import box_of, isolation_of_graph, joined_to
from deformrf.core.geometry import Plane

NOWHERE = np.array([[-np.inf] * 3, [np.inf] * 3])  # nothing goes on outside
CUBE = np.array([[0.0] * 3, [1.0] * 3])
WALL = 0.07  # of shells


def scene_of(inside, colors=None, box=NOWHERE, spacing=0.06) -> Isolation:
    return isolation_of_graph(matter_where(inside, colors, spacing), box)


def stroke(*points, this=True):
    return Stroke(np.array(points, float), this)


def iou(one, other):
    return (one & other).sum() / (one | other).sum()


def test_two_balls_are_parted_at_their_neck():
    left, right = ball((0.3, 0.5, 0.5), 0.23), ball((0.7, 0.5, 0.5), 0.23)
    scene = scene_of(any_of(left, right))
    strokes = [stroke((0.1, 0.5, 0.5)), stroke((0.9, 0.5, 0.5), this=False)]
    kept = isolated(scene, strokes).kept
    assert iou(kept, scene.matter.middles[:, 0] < 0.5) > 0.97


def test_the_other_way_around_the_other_ball_is_kept():
    scene = scene_of(any_of(ball((0.3, 0.5, 0.5), 0.23), ball((0.7, 0.5, 0.5), 0.23)))
    places = (0.1, 0.5, 0.5), (0.9, 0.5, 0.5)
    kept = [
        isolated(scene, [stroke(places[k]), stroke(places[1 - k], this=False)]).kept for k in (0, 1)
    ]
    assert (kept[0] & kept[1]).mean() < 0.01
    assert (kept[0] | kept[1]).mean() > 0.98


def test_one_click_keeps_a_ball_on_a_floor_without_the_floor():
    floor, toy = slab((0, 0, 0), (1, 1, WALL)), ball((0.5, 0.5, 0.33), 0.27, WALL)
    scene = scene_of(any_of(floor, toy), box=CUBE, spacing=0.05)
    result = isolated(scene, [stroke((0.5, 0.23, 0.33))])
    above = scene.matter.middles[:, 2] > WALL + 0.5 * scene.matter.edge
    assert iou(result.kept, above) > 0.95
    assert len(result.left_out) == 1
    said = left_out_in_words(scene, result)
    assert "% of the matter" in said and "a flat part that goes on" in said
    assert "box" in said and "box" not in left_out_in_words(scene, result, where=False)
    before = without_flats(scene)  # any click
    assert before.left_out == result.left_out
    assert iou(before.kept, above) > 0.95


def leaning():
    """A ball on a floor that leans on a block, no side of which reaches the floor."""
    floor, toy = slab((0, 0, 0), (1, 1, WALL)), ball((0.3, 0.5, 0.323), 0.25, WALL)
    outer, inner = (
        slab((0.54, 0.2, 0.3), (0.86, 0.8, 0.9)),
        slab((0.61, 0.27, 0.37), (0.79, 0.73, 0.83)),
    )

    def foot(points):
        return (np.linalg.norm(points[:, :2] - [0.73, 0.5], axis=1) < 0.17) & (points[:, 2] < 0.31)

    block = any_of(lambda points: outer(points) & ~inner(points), foot)
    return scene_of(any_of(floor, toy, block), box=CUBE, spacing=0.05), toy


def test_one_click_keeps_a_ball_without_the_block_that_it_leans_on():
    scene, toy = leaning()
    is_toy = toy(scene.matter.middles) & (scene.matter.middles[:, 2] > WALL)
    result = isolated(scene, [stroke((0.1, 0.5, 0.3))])
    assert iou(result.kept, is_toy) > 0.9
    assert len(result.left_out) == 2  # the floor and a side of the block


def test_a_head_on_a_narrow_neck_stays_with_its_body():
    floor, body = slab((0, 0, 0), (1, 1, WALL)), ball((0.5, 0.5, 0.24), 0.25, WALL)
    neck = slab((0.46, 0.46, 0.45), (0.54, 0.54, 0.6))
    head = slab((0.33, 0.33, 0.58), (0.67, 0.67, 0.85))
    scene = scene_of(any_of(floor, body, neck, head), box=CUBE, spacing=0.05)
    above = scene.matter.middles[:, 2] > WALL + scene.matter.edge
    clicks = [(0.5, 0.26, 0.3), (0.26, 0.5, 0.3), (0.5, 0.33, 0.7), (0.67, 0.5, 0.75)]
    for click in clicks:
        assert iou(isolated(scene, [stroke(click)]).kept, above) > 0.85, click


def test_a_flat_part_that_one_draw_finds_alone_is_not_offered():
    floor, toy = slab((0, 0, 0), (1, 1, WALL)), ball((0.5, 0.5, 0.33), 0.27, WALL)
    scene = scene_of(any_of(floor, toy), box=CUBE, spacing=0.05)
    found = next(draw for draw in scene.draws if draw)
    assert not without_flats(replace(scene, draws=[[], found, []])).left_out
    assert without_flats(replace(scene, draws=[found, [], found])).left_out


def test_of_lucky_and_unlucky_flat_parts_those_with_the_least_neck_count():
    floor, toy = slab((0, 0, 0), (1, 1, WALL)), ball((0.5, 0.5, 0.33), 0.27)
    scene = scene_of(any_of(floor, toy), box=CUBE, spacing=0.05)
    lucky = next(draw for draw in scene.draws if draw)
    plane = Plane(np.array([0.0, 0.0, 1.0]), 0.33)  # cuts the ball in two
    unlucky = [*lucky, replace(lucky[0], flat=replace(lucky[0].flat, plane=plane))]
    clicks = [stroke((0.5, 0.23, 0.5))]
    results = [
        isolated(replace(scene, draws=draws, last={}), clicks)
        for draws in ([lucky], [unlucky], [unlucky, lucky], [lucky, unlucky])
    ]
    kept = [scene.weights[result.kept].sum() for result in results]
    assert kept[1] < 0.7 * kept[0] and kept[2] == kept[3] == kept[0]


def test_draws_that_find_the_same_count_once(monkeypatch):
    floor, toy = slab((0, 0, 0), (1, 1, WALL)), ball((0.5, 0.5, 0.33), 0.27, WALL)
    scene = scene_of(any_of(floor, toy), box=CUBE, spacing=0.05)
    found, calls = next(draw for draw in scene.draws if draw), []
    parted = isolating.without_surroundings
    monkeypatch.setattr(isolating, "without_surroundings", lambda *a: calls.append(a) or parted(*a))
    click = [stroke((0.5, 0.23, 0.5))]
    once = isolated(replace(scene, draws=[found], last={}), click)
    twice = isolated(replace(scene, draws=[found, list(found)], last={}), click)
    assert len(calls) == 2
    np.testing.assert_array_equal(once.kept, twice.kept)
    isolated(replace(scene, draws=[found, []], last={}), click)
    assert len(calls) == 4


def test_a_click_on_the_floor_keeps_the_floor():
    floor, toy = slab((0, 0, 0), (1, 1, WALL)), ball((0.5, 0.5, 0.33), 0.27, WALL)
    scene = scene_of(any_of(floor, toy), spacing=0.05)
    result = isolated(scene, [stroke((0.1, 0.1, WALL))])
    low = scene.matter.middles[:, 2] < WALL
    assert result.kept[low].mean() > 0.95 and not result.left_out


@pytest.mark.parametrize("box", [CUBE, NOWHERE])
def test_a_box_keeps_its_sides(box):
    outer, inner = slab((0.2, 0.2, 0.2), (0.8, 0.8, 0.8)), slab((0.27,) * 3, (0.73,) * 3)
    scene = scene_of(lambda points: outer(points) & ~inner(points), box=box, spacing=0.05)
    assert isolated(scene, [stroke((0.5, 0.5, 0.8))]).kept.all()


def test_what_colors_tell_apart_is_parted_where_they_change():
    """A rod, red up to the third, seen as one piece by its shape."""

    def colors(points):
        red = points[:, 0] < 1.0 / 3.0
        return np.where(red[:, None], [0.9, 0.1, 0.1], [0.1, 0.1, 0.9])

    scene = scene_of(slab((0.05, 0.45, 0.45), (0.95, 0.55, 0.55)), colors)
    strokes = [stroke((0.1, 0.5, 0.5)), stroke((0.9, 0.5, 0.5), this=False)]
    kept = isolated(scene, strokes).kept
    assert iou(kept, scene.matter.middles[:, 0] < 1.0 / 3.0) > 0.93


def test_strokes_are_respected_and_the_last_one_counts():
    scene = scene_of(ball((0.5, 0.5, 0.5), 0.4))
    rng = np.random.default_rng()
    places = scene.matter.middles[rng.choice(len(scene.matter.tets), 8, replace=False)]
    sides = [True, *(rng.random(7) < 0.5).tolist()]
    strokes = [stroke(p, this=bool(this)) for p, this in zip(places, sides, strict=True)]
    kept = isolated(scene, strokes).kept
    own = [np.linalg.norm(scene.matter.middles - place, axis=1).argmin() for place in places]
    assert [bool(kept[i]) for i in own] == [bool(this) for this in sides] or len(set(own)) < 8
    again = isolated(scene, [*strokes, stroke(places[0], this=False), stroke(places[1])]).kept
    assert not again[own[0]] and again[own[1]]


def test_what_is_apart_from_the_object_goes():
    near, far = ball((0.25, 0.5, 0.5), 0.15), ball((0.75, 0.5, 0.5), 0.15)
    scene = scene_of(any_of(near, far))
    kept = isolated(scene, [stroke((0.25, 0.5, 0.5))]).kept
    np.testing.assert_array_equal(kept, scene.matter.middles[:, 0] < 0.5)
    both = isolated(scene, [stroke((0.25, 0.5, 0.5)), stroke((0.75, 0.5, 0.5))]).kept
    assert both.all()


def test_what_is_kept_is_joined_to_a_click():
    rng = np.random.default_rng()
    waves = rng.normal(size=(3, 3)) * 12.0
    inside = lambda points: np.sin(points @ waves).sum(axis=1) > 0.4  # noqa: E731
    scene = scene_of(inside, box=CUBE)
    point = scene.matter.middles[len(scene.matter.tets) // 2]
    kept = isolated(scene, [stroke(point)]).kept
    seed = np.zeros(len(kept), bool)
    seed[np.linalg.norm(scene.matter.middles - point, axis=1) < 2.0 * scene.matter.edge] = True
    np.testing.assert_array_equal(joined_to(scene.matter, seed, kept), kept)


def test_a_short_stroke_on_a_crumb_takes_the_crumb_alone():
    """Though the object's far side is nearer to the crumb than to the click."""
    rod, crumb = slab((0.05, 0.4, 0.4), (0.95, 0.6, 0.6)), ball((0.88, 0.5, 0.69), 0.1)
    scene = scene_of(any_of(rod, crumb))
    strokes = [stroke((0.1, 0.5, 0.5)), stroke((0.88, 0.5, 0.75), this=False)]
    kept = isolated(scene, strokes).kept
    assert iou(kept, scene.matter.middles[:, 2] < 0.6) > 0.95


def test_what_goes_on_at_the_border_is_told_from_what_touches_it():
    rod = slab((0.0, 0.42, 0.1), (1.0, 0.58, 0.25))
    scene = scene_of(any_of(rod, ball((0.5, 0.5, 0.72), 0.28)), box=CUBE, spacing=0.05)
    ends = scene.matter.middles[scene.border]
    assert len(ends) and (ends[:, 2] < 0.3).all()
    assert (ends[:, 0] < 0.5).any() and (ends[:, 0] > 0.5).any()


def test_what_is_joined_with_the_outside_by_more_than_with_the_object_goes():
    """A ball touches a beam that goes on; the box cuts off the end of the ball's own tail."""
    beam, toy = slab((0.3, 0.6, 0.0), (0.7, 0.8, 1.0)), ball((0.5, 0.36, 0.5), 0.26)
    scene = scene_of(any_of(beam, toy), box=CUBE, spacing=0.05)
    kept = isolated(scene, [stroke((0.5, 0.12, 0.5))]).kept
    assert iou(kept, toy(scene.matter.middles)) > 0.93
    tail = slab((0.45, 0.0, 0.45), (0.55, 0.3, 0.55))
    scene = scene_of(any_of(tail, toy), box=CUBE, spacing=0.05)
    assert isolated(scene, [stroke((0.5, 0.6, 0.5))]).kept.mean() > 0.95


def test_a_field_is_cut_and_says_where_it_goes_on(make_ball_field):
    field = make_ball_field(0)
    assert np.isinf(box_of(field)).all()  # the ball ends inside of the cube
    scene = isolation_of(field)
    middles = scene.matter.middles
    result = isolated(scene, [stroke(middles[0]), stroke(middles[-1], this=False)])
    smaller = kept_field(field, scene, result)
    np.testing.assert_array_equal(
        np.bitwise_count(smaller.occupancy).sum(), np.count_nonzero(result.kept)
    )
    assert smaller.mesh.tet_count <= field.mesh.tet_count


def test_no_stroke_and_strokes_beside_all_are_refused():
    scene = scene_of(ball((0.5, 0.5, 0.5), 0.3))
    with pytest.raises(ValueError, match="no stroke says"):
        isolated(scene, [stroke((0.5, 0.5, 0.5), this=False)])
    with pytest.raises(ValueError, match="no matter at 3 0 0"):
        isolated(scene, [stroke((3.0, 0.0, 0.0))])
