"""Which box becomes the unit cube."""

import numpy as np
import pytest
from image_datasets import from_images

from deformrf.core.render import look_at, pinhole
from deformrf.core.training import DatasetError, focus, world_to_unit_cube
from deformrf.core.training.data.scene_box import box_to_unit_cube


def dataset(poses, bounds=None):
    images = [np.zeros((2, 2, 4), np.uint8)] * len(poses)
    lenses = [pinhole(3.0, 2, 2)] * len(poses)
    return from_images(images, np.array(poses), lenses, "x" * len(poses), "train", (), bounds)


def around(center, distance, count=20):
    directions = np.random.default_rng().normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return [look_at(center + distance * d, center) for d in directions]


def mapped(matrix, point):
    return (matrix @ [*point, 1])[:3]


def test_a_radius_is_a_box_around_the_origin():
    matrix = world_to_unit_cube(dataset(around(np.ones(3), 4.0)), radius=1.5)
    corners = np.array([[-1.5, -1.5, -1.5, 1], [1.5, 1.5, 1.5, 1], [0, 0, 0, 1]])
    np.testing.assert_allclose((corners @ matrix.T)[:, :3], [[0] * 3, [1] * 3, [0.5] * 3])


def test_a_long_box_fits_and_is_centred():
    matrix = world_to_unit_cube(dataset(around(np.zeros(3), 4.0)), aabb=(0, 0, 0, 4, 2, 1))
    np.testing.assert_allclose(mapped(matrix, (0, 0, 0)), (0, 0.25, 0.375))
    np.testing.assert_allclose(mapped(matrix, (4, 2, 1)), (1, 0.75, 0.625))


def test_the_users_box_comes_before_the_datas():
    views = dataset(around(np.zeros(3), 4.0), bounds=np.array([[-1.0] * 3, [1.0] * 3]))
    np.testing.assert_allclose(mapped(world_to_unit_cube(views), (1, 1, 1)), (1, 1, 1))
    given = world_to_unit_cube(views, aabb=(0, 0, 0, 1, 1, 1))
    np.testing.assert_allclose(mapped(given, (1, 1, 1)), (1, 1, 1))
    np.testing.assert_allclose(mapped(given, (0, 0, 0)), (0, 0, 0))


def test_without_a_box_it_is_where_the_cameras_look():
    center = np.random.default_rng().normal(size=3)
    matrix = world_to_unit_cube(dataset(around(center, 4.031)))
    np.testing.assert_allclose(mapped(matrix, center), 0.5, atol=1e-9)
    np.testing.assert_allclose(mapped(matrix, center + 1.5), 1.0, atol=1e-9)


def test_the_focus_is_nearest_to_all_axes():
    poses = np.array(around(np.zeros(3), 3.0))
    poses[:, :3, 3] += np.random.default_rng().normal(size=(len(poses), 3)) * 0.05
    found = focus(poses)

    def distance(point):
        offset, axes = poses[:, :3, 3] - point, poses[:, :3, 2]
        return (np.cross(offset, axes) ** 2).sum()

    for step in np.vstack([np.eye(3), -np.eye(3)]) * 1e-3:
        assert distance(found) < distance(found + step)


def test_parallel_views_need_a_box():
    poses = [look_at((x, 0, 5), (x, 0, 0), up=(0, 1, 0)) for x in np.linspace(-1, 1, 9)]
    with pytest.raises(DatasetError, match="--aabb"):
        world_to_unit_cube(dataset(poses))
    world_to_unit_cube(dataset(poses), aabb=(-1, -1, -1, 1, 1, 1))


@pytest.mark.parametrize("aabb", [(0, 0, 0, 1, 0, 1), (1, 0, 0, 0, 1, 1), (0, 0, 0, 1, 1, np.nan)])
def test_an_empty_box_is_refused(aabb):
    with pytest.raises(DatasetError, match="--aabb has to be x0 y0 z0"):
        world_to_unit_cube(dataset(around(np.zeros(3), 4.0)), aabb=aabb)


@pytest.mark.parametrize("side", [np.inf, np.nan, 1e300, 1e-320, 0.0])
@pytest.mark.filterwarnings("error")
def test_a_box_without_a_size_is_refused(side):
    with pytest.raises(DatasetError, match=r"the box has to be x0 y0 z0 x1 y1 z1 .* up to 1e\+12"):
        box_to_unit_cube([[0.0] * 3, [side] * 3], "the box")
