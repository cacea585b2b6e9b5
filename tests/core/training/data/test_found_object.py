"""Where an object is: a synthetic table with a toy and a mug on it, seen by cameras around it."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.geometry import Plane
from deformrf.core.render import look_at, pinhole
from deformrf.core.training import find_object
from deformrf.core.training.data.found_object import (
    THICKNESS,
    attention,
    common_up,
    evened,
    ground_of,
)
from deformrf.core.training.data.scene_box import found_to_unit_cube
from deformrf.core.training.finding import said

LENS = pinhole(300.0, 320, 240)


def rotation(rng):
    """A random one.  [3, 3]"""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)


def cameras(rng, center, count=40, lowest=0.2, highest=0.9):
    """Camera poses on a part of a sphere of radius 3, hand-held.  [N, 4, 4]"""
    around = rng.uniform(0, 2 * np.pi, count)
    height = rng.uniform(lowest, highest, count)
    places = 3.0 * np.column_stack(
        [np.cos(around) * np.cos(height), np.sin(around) * np.cos(height), np.sin(height)]
    )
    aims = center + rng.normal(size=(count, 3)) * 0.1
    return np.stack(
        [look_at(p + center, a, [0, 0, 1.0]) for p, a in zip(places, aims, strict=True)]
    )


def cylinder(rng, count, center, radius, height):
    """Points of a standing cylinder's side and top."""
    a, r = rng.uniform(0, 2 * np.pi, count), radius * np.ones(count)
    z = rng.uniform(0, height, count)
    r[: count // 3] *= np.sqrt(rng.uniform(0, 1, count // 3))
    z[: count // 3] = height
    return np.column_stack([r * np.cos(a), r * np.sin(a), z]) + center


def table_scene(rng, scale=1.0):
    """Points of a table, a toy 1 high at (0, 0), a mug beside it, walls; and outliers."""
    table = np.column_stack([rng.uniform(-1.5, 1.5, (3000, 2)), np.zeros(3000)])
    toy = cylinder(rng, 1500, [0, 0, 0], 0.25, 1.0)
    mug = cylinder(rng, 400, [0.9, 0.2, 0], 0.15, 0.3)
    wall = np.column_stack([rng.uniform(-4, 4, 600), np.full(600, 4.0), rng.uniform(-1, 3, 600)])
    points = np.concatenate([table, toy, mug, wall])
    points += rng.normal(size=points.shape) * 0.005
    return np.concatenate([points, rng.uniform(-2, 2, (150, 3))]) * scale


@pytest.fixture
def turned(rng_or_seed=None):
    rng = np.random.default_rng()
    return rng, rotation(rng), rng.uniform(-5, 5, 3), rng.uniform(0.1, 10)


def in_world(points, poses, turn, shift, scale):
    poses = poses.copy()
    poses[:, :3, 3] = scale * poses[:, :3, 3] @ turn.T + shift
    poses[:, :3, :3] = turn @ poses[:, :3, :3]
    return scale * points @ turn.T + shift, poses


def test_what_stands_on_a_table_is_found_upright_in_any_world(turned):
    rng, turn, shift, scale = turned
    scene, poses = table_scene(rng), cameras(rng, np.array([0, 0, 0.4]))
    points, poses = in_world(scene, poses, turn, shift, scale)
    found = find_object(points, poses, [LENS] * len(poses))
    assert found.stands
    up = found.turn[2] @ turn
    assert np.degrees(np.arccos(up[2])) < 1.0
    world_to_model, box = found_to_unit_cube(found)

    def to_model(places):
        world = scale * np.asarray(places, float) @ turn.T + shift
        return world @ world_to_model[:3, :3].T + world_to_model[:3, 3]

    corners = to_model([[0.25, 0, 0.5], [-0.25, 0, 0.5], [0, 0.25, 0.9], [0, -0.25, 1.0]])
    assert ((corners > box[0]) & (corners < box[1])).all()
    size = (box[1] - box[0]) / np.cbrt(np.linalg.det(world_to_model[:3, :3])) / scale
    assert size[2] == pytest.approx(1.12, abs=0.05) and size.max() == size[2]
    assert (size[:2] < 1.0).all()  # the mug's middle stays outside
    assert not (
        (to_model([[0.9, 0.2, 0.15]]) > box[0]) & (to_model([[0.9, 0.2, 0.15]]) < box[1])
    ).all()
    assert box[0, 2] == pytest.approx(0.0) and (box >= 0).all() and box.max() == pytest.approx(1.0)
    assert to_model([[0, 0, 0]])[0, 2] == pytest.approx(0.0, abs=0.02)


def test_a_mat_with_much_texture_does_not_tilt_the_table():
    rng = np.random.default_rng()
    table = np.column_stack([rng.uniform(-1.5, 1.5, (500, 2)), np.zeros(500)])
    mat = np.column_stack([rng.uniform([0.1, -0.3], [0.7, 0.3], (2500, 2)), np.full(2500, 0.06)])
    points = np.concatenate([table, mat, cylinder(rng, 1500, [0, 0, 0], 0.25, 1.0)])
    points += rng.normal(size=points.shape) * 0.005
    poses = cameras(rng, np.array([0, 0, 0.4]))
    found = find_object(points, poses, [LENS] * len(poses))
    assert np.degrees(np.arccos(found.turn[2, 2])) < 1.0
    assert found.box[0, 2] == pytest.approx(0.0, abs=0.02)


def test_what_is_alone_in_its_cell_does_not_tilt_the_table():
    """Outliers beside a table, each in a cell of its own."""
    rng = np.random.default_rng()
    table = np.column_stack([rng.uniform(-0.4, 0.4, (2000, 2)), rng.normal(size=2000) * 0.004])
    x, y = 0.05 + 0.1 * np.mgrid[5:21, -12:13].reshape(2, -1)
    points = np.concatenate([table, np.column_stack([x, y, np.full(400, 0.03)])])
    guess, weights = Plane(np.array([0, 0, 1.0]), 0.0), np.ones(len(points))
    plane = evened(guess, points, weights, cameras(rng, np.zeros(3))[:, :3, 3], 1.0, rng)
    assert plane.offset == pytest.approx(0.0, abs=0.002) and plane.normal[2] > 0.9999


@pytest.mark.parametrize("numbers", ["[n]", "[n, 1]"])
def test_cells_are_numbered_as_by_any_numpy(monkeypatch, numbers):
    rng, unique = np.random.default_rng(), np.unique

    def of_2_0(*given, **named):
        values, number, counts = unique(*given, **named)
        return values, number.reshape(-1, 1), counts

    if numbers == "[n, 1]":
        monkeypatch.setattr(np, "unique", of_2_0)
    table = np.column_stack([rng.uniform(-1.0, 1.0, (2000, 2)), rng.normal(size=2000) * 0.004])
    guess, places = Plane(np.array([0, 0.05, 1.0]), 0.0), cameras(rng, np.zeros(3))[:, :3, 3]
    assert evened(guess, table, np.ones(2000), places, 3.0, rng).normal[2] > 0.9999


@pytest.mark.parametrize("lowest, moves", [(1.0, True), (-0.1, False)])
def test_a_plane_is_refit_only_if_the_cameras_stay_in_front(lowest, moves):
    """Cameras on one side are a bit below a table, and above the tilted mat on it."""
    rng = np.random.default_rng()
    table = np.column_stack([rng.uniform(-1.0, 1.0, (1000, 2)), rng.normal(size=1000) * 0.002])
    guess = Plane(np.array([np.sin(0.06), 0.0, np.cos(0.06)]), 0.0)
    places = np.array([[-3.0, 0, 2.0]] * 9 + [[3.0, 0, lowest]])
    plane = evened(guess, table, np.ones(1000), places, 3.0, rng)
    assert (plane.height(places) > 0.0).all()
    assert (plane is not guess) == moves


def test_arms_that_are_spread_are_no_table():
    """They lie in a plane with a head on it, but the body is below it, where a table hides all."""
    rng = np.random.default_rng()
    arms = np.column_stack([rng.uniform(-0.8, 0.8, (1500, 2)), np.full(1500, 0.6)])
    arms = arms[(abs(arms[:, :2]) < 0.12).any(axis=1)]
    head = cylinder(rng, 500, [0, 0, 0.65], 0.2, 0.35)
    points = np.concatenate([table_scene(rng), arms, head])
    poses = cameras(rng, np.array([0, 0, 0.5]))
    found = find_object(points, poses, [LENS] * len(poses))
    assert found.stands
    assert found.box[0, 2] == pytest.approx(0.0, abs=0.02)


def test_what_hangs_on_a_wall_is_found_behind_no_wall():
    rng = np.random.default_rng()
    wall = np.column_stack([rng.uniform(-2, 2, 4000), np.zeros(4000), rng.uniform(-2, 2, 4000)])
    head = cylinder(rng, 2000, [0, 0, 0], 0.3, 1.0)[:, [0, 2, 1]] * [1, -1, 1]  # towards -y
    points = np.concatenate([wall, head]) + rng.normal(size=(6000, 3)) * 0.005
    angles = rng.uniform(-1, 1, (40, 2))
    places = [3 * np.array([np.sin(a), -np.cos(a), 0.5 * b]) for a, b in angles]
    poses = np.stack([look_at(p, [0, -0.4, 0], [0, 0, 1.0]) for p in places])
    found = find_object(points, poses, [LENS] * 40)
    assert not found.stands
    # Up is the mean of 40 random cameras' up, which leans by some degrees.
    np.testing.assert_allclose(found.turn, np.eye(3), atol=0.1)
    assert found.box[1, 1] == pytest.approx(0.0, abs=0.02)
    assert -1.3 < found.box[0, 1] < -1.0 and found.box[1, 0] < 0.6


def test_without_a_plane_nothing_is_found():
    rng = np.random.default_rng()
    ball = rng.normal(size=(3000, 3))
    ball *= 0.5 / np.linalg.norm(ball, axis=1, keepdims=True)
    poses = cameras(rng, np.zeros(3), lowest=-1.2, highest=1.2)
    assert find_object(ball, poses, [LENS] * len(poses)) is None


@pytest.mark.parametrize("count", [0, 10])
def test_too_few_points_find_nothing(count):
    rng = np.random.default_rng()
    poses = cameras(rng, np.zeros(3))
    assert find_object(rng.normal(size=(count, 3)), poses, [LENS] * len(poses)) is None


def test_an_empty_table_has_no_object():
    rng = np.random.default_rng()
    table = np.column_stack([rng.uniform(-1.5, 1.5, (3000, 2)), np.zeros(3000)])
    poses = cameras(rng, np.zeros(3))
    noisy = table + rng.normal(size=table.shape) * 0.003
    assert find_object(noisy, poses, [LENS] * len(poses)) is None


def test_points_that_are_not_finite_do_not_count():
    rng = np.random.default_rng()
    scene, poses = table_scene(rng), cameras(rng, np.array([0, 0, 0.4]))
    bad = np.concatenate([scene, [[np.nan] * 3, [np.inf, 0, 0]]])
    assert find_object(bad, poses, [LENS] * len(poses)) is not None


def test_attention_is_highest_in_the_middle_of_the_images():
    rng = np.random.default_rng()
    poses = cameras(rng, np.zeros(3))
    middle, aside, outside = attention(
        np.array([[0, 0, 0], [0.8, 0, 0], [0, 0, 50.0]]), poses, [LENS] * len(poses)
    )
    assert 1.0 >= middle > aside > outside >= 0.0


def test_the_ground_is_found_anew_beside_a_guess():
    rng = np.random.default_rng()
    scene = table_scene(rng)[:4500] + np.array([0, 0, 0.03])
    guess = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
    ground = ground_of(scene, guess, 0.1)
    assert ground.offset == pytest.approx(0.03, abs=0.004)
    assert ground.normal[2] > 0.9999
    assert ground_of(5.0 + scene, guess, 0.1) is guess  # nothing is near


def test_up_is_common():
    poses = cameras(np.random.default_rng(), np.zeros(3))
    assert common_up(poses)[2] > 0.95
    assert THICKNESS < 0.02


def test_masks_vote_for_what_is_looked_at_less():
    """The mug is the object if masks say so."""
    rng = np.random.default_rng()
    scene, poses = table_scene(rng), cameras(rng, np.array([0, 0, 0.4]))
    masks = []
    for pose in poses:
        seen = (np.array([0.9, 0.2, 0.15]) - pose[:3, 3]) @ pose[:3, :3]
        x, y = 300.0 * seen[:2] / -seen[2] * [1, -1] + [160, 120]
        columns, rows = np.meshgrid(np.arange(320) + 0.5, np.arange(240) + 0.5)
        masks.append(255 * (np.hypot(columns - x, rows - y) < 32).astype(np.uint8))
    found = find_object(scene, poses, [LENS] * len(poses), lambda view: masks[view])
    assert found.stands
    middle = found.turn @ np.array([0.9, 0.2, 0.15])
    assert ((middle > found.box[0]) & (middle < found.box[1])).all()
    assert not (found.turn @ np.array([0, 0, 0.5]) > found.box[0]).all()


def test_another_thing_on_the_table_is_told():
    rng = np.random.default_rng()
    twin = cylinder(rng, 1500, [0.2, 1.1, 0], 0.25, 1.0)
    points, poses = np.concatenate([table_scene(rng), twin]), cameras(rng, np.array([0, 0, 0.4]))
    found = find_object(points, poses, [LENS] * len(poses))
    middle = found.box.mean(axis=0) @ found.turn
    assert np.linalg.norm(middle[:2]) < 0.1, "what is looked at most is the object"
    low, high = found.others[0]
    np.testing.assert_allclose(0.5 * (low + high)[:2], [0.2, 1.1], atol=0.1)
    numbers = " ".join(f"{value:.3g}" for value in (*low, *high))
    assert f"left out, the one that is looked at most at about --aabb {numbers}" in said(
        replace(found, others=found.others[:1] * 2)
    )
    assert "Another thing beside it" in said(replace(found, others=found.others[:1]))
