"""A capture of a toy on a table, made here: the run finds the toy and trains it alone."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import warp as wp
from image_datasets import from_images

from deformrf.core.field import subtet_middles, unpack_mask
from deformrf.core.render import Camera, camera_rays, look_at, pinhole
from deformrf.core.training import finding, load_checkpoint, preset, trained_tets, trainer
from deformrf.core.training.data.scene_box import seeks_object
from deformrf.core.training.finding import FoundBox, ends_of_rays, first_workers, search
from deformrf.core.training.run import optimization
from deformrf.core.training.run.distributed import ALONE
from deformrf.core.training.run.monitoring import TrainingProgress
from deformrf.core.training.run.optimization import Optimization

LENS = pinhole(60.0, 48, 40)
RADIUS, HEIGHT = 0.3, 0.9
TILT = look_at(np.array([0.3, -2.0, 0.4]), np.zeros(3))[:3, :3]  # of the data's world
SHIFT = np.array([5.0, -3.0, 2.0])


def photograph(pose):
    """What a camera sees: a cylinder on a checkered table under a gray sky.  [H, W, 4] uint8"""
    origins, directions = camera_rays(Camera(pose, LENS))
    t = -origins[:, 2] / np.minimum(directions[:, 2], -1e-9)
    hit = origins + t[:, None] * directions
    board = (np.floor(4 * hit[:, 0]) + np.floor(4 * hit[:, 1])) % 2
    color = np.where(board[:, None] > 0, [0.7, 0.5, 0.3], [0.3, 0.2, 0.1])
    away = (directions[:, 2] > -1e-3) | (np.abs(hit[:, :2]).max(axis=1) > 3.0)
    color[away], t[away] = 0.6, np.inf
    a = (directions[:, :2] ** 2).sum(axis=1)
    b = (origins[:, :2] * directions[:, :2]).sum(axis=1)
    root = b * b - a * ((origins[:, :2] ** 2).sum(axis=1) - RADIUS**2)
    side = (-b - np.sqrt(np.maximum(root, 0.0))) / a
    z = origins[:, 2] + side * directions[:, 2]
    is_side = (root > 0) & (z > 0) & (z < HEIGHT) & (side < t)
    color[is_side] = np.stack([0.9 - 0 * z, z / HEIGHT, 0.2 + 0 * z], axis=1)[is_side]
    top = (HEIGHT - origins[:, 2]) / np.minimum(directions[:, 2], -1e-9)
    place = origins + top[:, None] * directions
    is_top = (np.hypot(place[:, 0], place[:, 1]) < RADIUS) & (directions[:, 2] < 0)
    color[is_top] = [0.2, 0.9, 0.9]
    pixels = np.concatenate([color, np.ones((len(color), 1))], axis=1)
    return np.round(255 * pixels).astype(np.uint8).reshape(LENS.height, LENS.width, 4)


@pytest.fixture(scope="module")
def capture():
    rng = np.random.default_rng(1)
    poses = []
    for angle in np.arange(30) * 2.4:
        height = rng.uniform(0.3, 0.9)
        flat = np.array([np.cos(angle), np.sin(angle)]) * np.cos(height)
        poses.append(look_at(3.0 * np.array([*flat, np.sin(height)]), np.array([0, 0, 0.4])))
    images = [photograph(pose) for pose in poses]
    poses = np.stack(poses)
    poses[:, :3, 3] = poses[:, :3, 3] @ TILT.T + SHIFT
    poses[:, :3, :3] = TILT @ poses[:, :3, :3]
    return from_images(images, poses, [LENS] * len(poses), map(str, range(len(poses))), "train")


def surface(rng):
    """Sparse points of the scene in the data's world."""
    a = rng.uniform(0, 2 * np.pi, 800)
    toy = np.column_stack([RADIUS * np.cos(a), RADIUS * np.sin(a), rng.uniform(0, HEIGHT, 800)])
    table = np.column_stack([rng.uniform(-1.5, 1.5, (1500, 2)), np.zeros(1500)])
    points = np.concatenate([toy, table]) + rng.normal(size=(2300, 3)) * 0.003
    return points @ TILT.T + SHIFT


def degrees_from_upright(world_to_model):
    up = world_to_model[:3, :3] @ TILT[:, 2]
    return np.degrees(np.arccos(up[2] / np.linalg.norm(up)))


@pytest.fixture
def few_steps(monkeypatch):
    """Runs of so few steps that everything is fog still."""
    monkeypatch.setattr(finding, "LOOK_RAYS", 1 << 10)
    monkeypatch.setattr(optimization, "RAYS_AT_START", 1 << 8)
    monkeypatch.setattr(trainer, "COARSE_UNSEEN_WEIGHT", 0.0)
    monkeypatch.setattr(trainer, "UNSEEN_WEIGHT", 0.0)
    monkeypatch.setattr(trained_tets, "FOG", 0.0)


def test_the_object_alone_is_trained_upright(capture, few_steps):
    """A few steps, which tell where things are, and not yet what they look like."""
    dataset = replace(capture, points=surface(np.random.default_rng()))
    few = {"coarse_steps": 3, "fine_steps": 3, "samples_per_step": 2**9}
    trained = trainer.train(dataset, preset("tiny", spacing=0.1, **few))
    field, whole = trained.field, trained.whole
    found = FoundBox.of_report(trained.report)
    assert trained.complete and found.stands
    assert degrees_from_upright(field.world_to_model) < 1.0
    scale = np.cbrt(np.linalg.det(field.world_to_model[:3, :3]))
    foot = field.world_to_model[:3, :3] @ SHIFT + field.world_to_model[:3, 3]
    np.testing.assert_allclose(foot, [0.5, 0.5, 0.0], atol=0.03)
    assert scale * HEIGHT == pytest.approx(1.0 / 1.12, abs=0.05)  # with its margin
    left = subtet_middles(field.mesh)[unpack_mask(field.occupancy)]
    before = subtet_middles(whole.mesh)[unpack_mask(whole.occupancy)]
    # It is cut where the field has the plane's surface, which is fog after these steps.
    assert left[:, 2].min() > -found.slack > before[:, 2].min()
    assert field.mesh.tet_count <= whole.mesh.tet_count


def test_a_run_that_is_resumed_keeps_the_box(capture, few_steps, monkeypatch, tmp_path):
    dataset = replace(capture, points=surface(np.random.default_rng()))
    few = {"coarse_steps": 2, "fine_steps": 2, "samples_per_step": 2**9}
    options, path = preset("tiny", spacing=0.15, **few), tmp_path / "m.checkpoint"
    steps = iter([None] * 3 + [KeyboardInterrupt] * 99)

    def step(self, *arguments, before=Optimization.step):
        if error := next(steps):
            raise error
        before(self, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Optimization, "step", step)
        first = trainer.train(dataset, options, checkpoint_path=path)
    assert first.interrupted
    second = trainer.train(
        replace(dataset, points=None), options, resumed=load_checkpoint(path), checkpoint_path=path
    )
    assert second.complete
    np.testing.assert_array_equal(second.field.world_to_model, first.field.world_to_model)
    assert second.report["object_box"] == first.report["object_box"]


def test_without_points_those_of_a_coarse_field_are_looked_at(capture, few_steps, monkeypatch):
    monkeypatch.setattr(finding, "STEPS", 2)
    asked = []

    def points_of(dataset, world_to_model, *rest, before=finding.coarse_points):
        points = before(dataset, world_to_model, *rest)
        asked.append(points @ world_to_model[:3, :3].T + world_to_model[:3, 3])
        return surface(np.random.default_rng())

    monkeypatch.setattr(finding, "coarse_points", points_of)
    too_few = replace(capture, points=np.zeros((5, 3)))
    with TrainingProgress(False) as progress:
        found, world_to_model = search(too_few, 0, "cpu", ALONE, progress)
    assert found.stands and degrees_from_upright(world_to_model) < 1.0
    (points,) = asked
    assert ((points > -0.2) & (points < 1.2)).all()
    monkeypatch.setattr(finding, "coarse_points", lambda *_: np.zeros((5, 3)))
    with TrainingProgress(False) as progress:
        assert search(too_few, 0, "cpu", ALONE, progress) == (None, None)


def test_only_photographs_that_nothing_else_says_are_searched(capture):
    options = preset("tiny")
    assert seeks_object(capture, options)
    for known in ({"aabb": (0, 0, 0, 1, 1, 1)}, {"scene_radius": 1.0}, {"surroundings": "white"}):
        assert not seeks_object(capture, replace(options, **known))
    assert not seeks_object(capture, replace(options, leave_out=("found-box",)))
    assert not seeks_object(replace(capture, bounds=np.eye(3)[:2]), options)
    cut_out = capture.pixels.copy()
    cut_out[0, 3] = 0
    assert not seeks_object(replace(capture, pixels=cut_out), options)


@pytest.mark.parametrize("stands, axis, side", [(True, 2, 0), (False, 1, 1)])
def test_room_for_the_ground_is_behind_the_plane_only(stands, axis, side):
    box = np.array([[0.2, 0.3, 0.0], [0.8, 0.7, 1.0]])
    found = FoundBox(box, stands)
    assert FoundBox.of_report(found.as_report()).plane.height(box[side]) == pytest.approx(0.0)
    assert found.plane.height(box.mean(axis=0)) > 0.0
    outward = found.space - box
    assert outward[side, axis] == pytest.approx(-1.0 if side == 0 else 1.0)
    outward[side, axis] = 0.0
    assert not outward.any()
    assert FoundBox.of_report({}) is None
    assert first_workers(None, "cpu", ALONE) is None


def test_rays_end_where_half_of_their_light_is_gone():
    class Rays:
        counts = wp.array([3, 0, 2], dtype=int, device="cpu")
        ends = wp.array([3, 3, 5], dtype=int, device="cpu")
        origins, directions = torch.zeros(3, 3), torch.eye(3)

        class samples:
            t = wp.array([1.0, 2.0, 3.0, 4.0, 5.0], dtype=float, device="cpu")

    points = ends_of_rays(Rays, torch.tensor([0.3, 0.3, 0.3, 0.1, 0.2]))
    np.testing.assert_allclose(points.numpy(), [[2.0, 0.0, 0.0]])  # the third keeps 0.7
