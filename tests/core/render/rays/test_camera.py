"""The camera: rays and projection are inverse to each other."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.render import (
    Camera,
    Lens,
    camera_rays,
    from_field_of_view,
    in_space,
    look_at,
    pinhole,
    view_projection,
)


@pytest.fixture
def camera():
    rng = np.random.default_rng()
    return from_field_of_view(look_at(rng.normal(size=3) + 4.0, rng.normal(size=3)), 0.7, 40, 30)


@pytest.fixture(params=["pinhole", "parallel", "beside"])
def any_camera(request, camera):
    """A pinhole camera, one of parallel rays, and one whose axis is not in the middle."""
    lens = Lens(40, 30, (9.0, 9.0), (8.0, 16.0)) if request.param == "beside" else camera.lens
    return replace(camera, lens=lens, parallel=request.param == "parallel")


def test_look_at_is_a_rotation_that_faces_the_target(camera):
    turn = camera.camera_to_world[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    pose = look_at((4, 3, 2), (1, 1, 1))
    forward = -pose[:3, 2]
    np.testing.assert_allclose(np.cross(forward, np.array([-3, -2, -1])), 0.0, atol=1e-12)


def test_points_on_a_ray_project_to_its_pixel(any_camera):
    camera = any_camera
    origins, directions = camera_rays(camera)
    t = np.random.default_rng().uniform(1.0, 5.0, len(origins))
    points = np.column_stack([origins + t[:, None] * directions, np.ones(len(t))])
    clip = points @ view_projection(camera, 0.1, 10.0).T
    ndc = clip[:, :3] / clip[:, 3:]
    u, v = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    np.testing.assert_allclose((ndc[:, 0] + 1) * 20, u.ravel(), atol=1e-9)
    np.testing.assert_allclose((1 - ndc[:, 1]) * 15, v.ravel(), atol=1e-9)
    assert (np.abs(ndc[:, 2]) < 1).all()


def test_parallel_rays_show_one_size_at_every_distance():
    camera = Camera(look_at((4, 3, 2), (1, 1, 1)), pinhole(20.0, 40, 30), parallel=True)
    origins, directions = camera_rays(camera)
    assert directions == pytest.approx(np.tile(camera.forward, (1200, 1)))
    assert (origins - camera.position) @ camera.forward == pytest.approx(0.0, abs=1e-12)
    right = camera.camera_to_world[:3, 0]
    assert (origins[1] - origins[0]) @ right == pytest.approx(1 / 20)  # a pixel
    assert (origins.mean(axis=0) - camera.position) == pytest.approx(0.0, abs=1e-12)


def test_the_field_of_view_is_that_of_the_outer_pixels_edges(camera):
    half = np.arctan(0.5 * camera.width / camera.focal)
    assert 2 * half == pytest.approx(0.7)


def test_resizing_keeps_the_vertical_field_of_view(camera):
    small = camera.resized(20, 15)
    assert small.height / small.focal == pytest.approx(camera.height / camera.focal)


def test_resizing_a_pinhole_scales_its_focal_length_in_a_fixed_order(camera):
    """To the last bit: images of earlier versions can be rendered again."""
    for height in range(1, 200):
        resized = camera.resized(20, height)
        assert resized.focal == camera.focal * height / camera.height
        assert resized.lens == pinhole(resized.focal, 20, height)


def test_a_shifted_axis_and_unequal_focal_lengths_project_to_their_pixels(camera):
    lens = Lens(40, 30, (50.0, 47.0), (18.0, 17.0))
    camera = replace(camera, lens=lens)
    origins, directions = camera_rays(camera)
    points = np.column_stack([origins + 2.0 * directions, np.ones(len(origins))])
    clip = points @ view_projection(camera, 0.1, 10.0).T
    u, v = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    np.testing.assert_allclose((clip[:, 0] / clip[:, 3] + 1) * 20, u.ravel(), atol=1e-9)
    np.testing.assert_allclose((1 - clip[:, 1] / clip[:, 3]) * 15, v.ravel(), atol=1e-9)


def test_a_similarity_takes_cameras_along_with_what_they_see(camera):
    rng = np.random.default_rng()
    turn = look_at(rng.normal(size=3), rng.normal(size=3))[:3, :3]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = 0.3 * turn, rng.normal(size=3)
    pose = in_space(camera.camera_to_world, matrix)
    np.testing.assert_allclose(pose[:3, :3], turn @ camera.camera_to_world[:3, :3], atol=1e-12)
    seen = rng.normal(size=3)  # in the camera's axes
    before = camera.camera_to_world[:3, :3] @ seen + camera.camera_to_world[:3, 3]
    after = matrix[:3, :3] @ before + matrix[:3, 3]
    np.testing.assert_allclose(pose[:3, :3].T @ (after - pose[:3, 3]), 0.3 * seen, atol=1e-12)


def test_without_a_rotation_a_cameras_axes_stay_bit_for_bit(camera):
    matrix = np.diag([0.37, 0.37, 0.37, 1.0])
    pose = in_space(camera.camera_to_world, matrix)
    assert (pose[:3, :3] == camera.camera_to_world[:3, :3]).all()
