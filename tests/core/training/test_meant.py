"""What photographs mean: a thing that leans on another is cut off by itself; one alone isn't."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from solids import any_of, ball, matter_where, slab

from deformrf.core.field import Isolated
from deformrf.core.field.isolation.isolating import isolation_of_graph
from deformrf.core.render import look_at
from deformrf.core.training import meant as meaning
from deformrf.core.training.meant import click_of, is_sure, meant

CUBE = np.array([[0.0] * 3, [1.0] * 3])
TOY = ball((0.5, 0.36, 0.5), 0.26)
BEAM = slab((0.3, 0.6, 0.0), (0.7, 0.8, 1.0))
MIDDLE = np.array([0.5, 0.4, 0.5])


def cameras(place=MIDDLE):
    """Five in an arc before a place."""
    angles = np.radians(np.linspace(-50.0, 50.0, 5))
    away = np.stack([np.sin(angles), -np.cos(angles), 0.2 * np.ones(5)], axis=1)
    return np.stack([look_at(place + 2.0 * step, place) for step in away])


@pytest.fixture
def meant_of(monkeypatch):
    """What is meant by cameras that look at solids: which of their matter stays, or None."""

    def find(inside, colors=None, poses=None, place=MIDDLE, box=CUBE):
        scene = isolation_of_graph(matter_where(inside, colors, spacing=0.06), box)
        monkeypatch.setattr(meaning, "isolation_of", lambda field: scene)
        monkeypatch.setattr(meaning, "kept_field", lambda field, scene, result: result.kept)
        occupied = SimpleNamespace(occupancy=np.ones(scene.matter.tet_count, np.uint64))
        found = meant(occupied, cameras(place) if poses is None else poses, place)
        return scene, found

    return find


def beam_is_gray(points):
    return np.where(BEAM(points)[:, None], [0.5, 0.5, 0.5], [0.9, 0.2, 0.1])


def test_a_ball_that_leans_on_a_beam_is_meant_without_the_beam(meant_of):
    scene, found = meant_of(any_of(TOY, BEAM), beam_is_gray)
    truth = TOY(scene.matter.middles) & ~BEAM(scene.matter.middles)
    kept = found.field
    assert (kept & truth).sum() / (kept | truth).sum() > 0.93
    gone = scene.weights[~kept].sum() / scene.weights.sum()
    assert found.share == pytest.approx(gone)


def test_an_object_alone_is_left_alone(meant_of):
    assert meant_of(TOY)[1] is None
    arms = any_of(TOY, ball((0.8, 0.36, 0.5), 0.1), ball((0.2, 0.36, 0.5), 0.1))
    assert meant_of(arms)[1] is None


def test_an_object_that_the_box_cuts_off_is_left_alone(meant_of):
    tail = slab((0.45, 0.0, 0.45), (0.55, 0.3, 0.55))
    assert meant_of(any_of(tail, TOY))[1] is None


def test_cameras_that_do_not_look_at_one_thing_mean_nothing(meant_of):
    left, right = ball((0.25, 0.4, 0.5), 0.15), ball((0.75, 0.4, 0.5), 0.15)
    floor = slab((0.0, 0.0, 0.0), (1.0, 1.0, 0.07))
    poses = cameras()
    poses[:, :3, 3] = np.array([0.5, -2.0, 0.5])
    poses[::2, :3, 3] += [-1.5, 0.0, 0.0]
    place = np.array([0.5, 3.0, 0.5])  # one half looks past the left ball, the other between both
    _, found = meant_of(any_of(left, right, floor), poses=poses, place=place)
    assert found is None


def test_an_empty_field_means_nothing(make_ball_field):
    field = make_ball_field(0)
    assert (
        meant(replace(field, occupancy=np.zeros_like(field.occupancy)), cameras(), MIDDLE) is None
    )


def test_a_click_is_where_the_way_meets_matter():
    scene = isolation_of_graph(matter_where(TOY), CUBE)
    click = click_of(scene, np.array([0.5, -2.0, 0.5]), MIDDLE)
    np.testing.assert_allclose(click, [0.5, 0.1, 0.5], atol=1.5 * scene.matter.edge)
    beside = click_of(scene, np.array([3.0, 3.0, 3.0]), np.array([1.0, 1.0, 1.0]))
    assert np.linalg.norm(beside - [0.5, 0.36, 0.5]) < 0.27


def test_what_is_parted_through_its_middle_is_not_sure():
    scene = isolation_of_graph(matter_where(any_of(TOY, BEAM)), CUBE)
    middles = scene.matter.middles
    assert is_sure(scene, Isolated(TOY(middles) & ~BEAM(middles), ()))
    assert not is_sure(scene, Isolated(middles[:, 2] > 0.45, ()))  # the neck is wide
    assert not is_sure(scene, Isolated(BEAM(middles), ()))  # what stays goes on
    assert not is_sure(scene, Isolated(np.ones(len(middles), bool), ()))
