"""What photographs saw: marks elsewhere, by the angle to the nearest one, in any pose."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.core.field import pack_mask, subtet_middles, unpack_mask
from deformrf.core.render import Lens, from_field_of_view, look_at, rows_of_views
from deformrf.viewer.document import Scene
from deformrf.viewer.layers import Photographed, photographed
from deformrf.viewer.layers.photographed import HARDLY, MISSED
from deformrf.wings.capture import directions, sphere

AWAY, NEAR_SIDE = 3.0, 0.18  # from the middle: of eyes; of what is seen and not at the rim
FEW = 0.06  # of the marks of a side: its rim, where sub-tets are larger than what a pixel tells
LENS = Lens(64, 64, (110.0, 110.0), (32.0, 32.0))


def eye_at(degrees, center):
    """In the level of the center, so many degrees from the front."""
    angle = np.radians(degrees)
    return center + AWAY * np.array([np.sin(angle), -np.cos(angle), 0.0])


def scene_of(field, degrees=(0.0,)):
    middle = field.mesh.rest_vertices.mean(axis=0)
    poses = np.array([look_at(eye_at(one, middle), middle) for one in degrees])
    meta = {**field.meta, "views": rows_of_views(poses, [LENS] * len(poses))}
    return Scene(replace(field, meta=meta), "ball", "cpu")


@pytest.fixture
def seen_from():
    """A function: the marks of a scene as an eye sees them, so many degrees from the front."""

    def look(scene, degrees, shown=None):
        shown = shown or Photographed(scene, "cpu")
        eye = eye_at(degrees, scene.center)
        camera = from_field_of_view(look_at(eye, scene.center), 0.6, 64, 64)
        marks = shown.marks(camera)
        while shown.busy:
            assert marks is None and "%" in shown.told
            marks = shown.marks(camera)
        places, tints, radius = marks
        assert radius > 0.0 and len(places) == len(tints)
        towards = (places - scene.center) @ (eye - scene.center) / AWAY
        red = tints @ [1.0, 0.0, 0.0] < 0.7
        return SimpleNamespace(near=towards > NEAR_SIDE, red=red, tints=tints, places=places)

    return look


def test_angles_and_colors_are_those_of_a_checks_page():
    assert (photographed.NEAR, photographed.FAR) == (directions.NEAR, directions.FAR)
    assert (HARDLY, MISSED) == (sphere.HARDLY, sphere.MISSED)


def test_the_front_has_no_marks_from_the_front_and_the_back_is_red(ball, seen_from):
    scene = scene_of(ball)
    front, back = seen_from(scene, 0.0), seen_from(scene, 180.0)
    assert front.near.sum() < FEW * back.near.sum() > 20 and front.red.all()  # what is behind
    assert back.red[back.near].all()
    reds = {tuple(np.round(255 * tint)) for tint in back.tints[back.near]}
    assert reds == {tuple(np.float64(MISSED)), tuple(np.round(0.5 * np.array(MISSED, float)))}


def test_from_beside_it_is_yellow_and_from_farther_red(ball, seen_from):
    scene = scene_of(ball)
    aside = seen_from(scene, 32.0)
    both = aside.near & (aside.places[:, 1] < scene.center[1] - NEAR_SIDE)  # seen by both eyes
    assert both.sum() > 500 and aside.red[both].mean() < FEW
    assert (abs(255 * aside.tints - HARDLY).max(axis=1) < 1e-6)[both & ~aside.red].all()
    assert seen_from(scene, 60.0).red.all()
    assert seen_from(scene_of(ball, (0.0, 32.0)), 32.0).near.sum() < FEW * aside.near.sum()


def test_what_was_hidden_by_something_is_red(ball, seen_from):
    """A slit: what was behind the front half is not seen, though the front half was cut since."""
    away = abs(subtet_middles(ball.mesh)[..., 1] - 0.5) > 0.03
    scene = scene_of(replace(ball, occupancy=pack_mask(unpack_mask(ball.occupancy) & away)))
    shown = Photographed(scene, "cpu")
    before = seen_from(scene, 0.0, shown).near.sum()
    scene.cuts.delete(pack_mask(subtet_middles(ball.mesh)[..., 1] < 0.5))
    now = seen_from(scene, 0.0, shown)
    assert now.red.all() and (now.places[:, 1] > 0.5).all()
    assert (now.places[:, 1] < 0.6).sum() > before + 200


def test_what_has_turned_with_the_object_is_looked_at_from_where_it_was(ball, seen_from):
    scene = scene_of(ball)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # a quarter
    rest = scene.field.mesh.rest_vertices
    turned = (rest - scene.center) @ turn.T + scene.center
    names = "field", "cuts", "center", "size"
    posed = SimpleNamespace(positions=turned, **{name: getattr(scene, name) for name in names})
    front, aside = seen_from(posed, 90.0), seen_from(posed, 0.0)
    assert front.near.sum() < FEW * aside.near.sum() > 20  # the front is there now
