"""Pixels to vertices and back."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from deformrf.core.render import Camera, camera_rays, look_at, pinhole
from deformrf.viewer.camera import picking

CAMERA = Camera(look_at([0.5, -2, 0.8], [0.5, 0.5, 0.5]), pinhole(200.0, 160, 120))
BESIDE = replace(CAMERA, lens=replace(CAMERA.lens, center=(40.0, 65.0)))
PARALLEL = replace(BESIDE, parallel=True)
each_camera = pytest.mark.parametrize("camera", [CAMERA, BESIDE, PARALLEL])


@each_camera
def test_project_agrees_with_the_rays_of_the_renderer(camera):
    origins, directions = camera_rays(camera)
    t = np.linspace(1, 3, len(origins))
    pixels, distances = picking.project(camera, origins + t[:, None] * directions)
    u, v = np.meshgrid(np.arange(160) + 0.5, np.arange(120) + 0.5)
    np.testing.assert_allclose(pixels, np.stack([u.ravel(), v.ravel()], axis=1), atol=1e-9)
    np.testing.assert_allclose(distances, t)


@each_camera
def test_the_ray_of_a_pixel_is_the_renderers(camera):
    pixel = (33.5, 70.5)
    for found, all_rays in zip(picking.ray(camera, pixel), camera_rays(camera), strict=True):
        np.testing.assert_allclose(found, all_rays[70 * 160 + 33], atol=1e-12)
    (again,), (t,) = picking.project(camera, picking.point_at(camera, pixel, 1.7)[None])
    assert (*again, t) == pytest.approx((*pixel, 1.7))


@each_camera
def test_what_is_behind_the_camera_is_nowhere(camera):
    behind = camera.position - 0.1 * camera.forward
    pixels, t = picking.project(camera, behind[None])
    assert np.isnan(pixels).all()
    assert t[0] == -np.inf
    assert not picking.visible(camera, behind[None], None, 0.1)[0]
    assert picking.pick_sphere(camera, (80, 60), behind[None], 0.1, 5.0) is None


@each_camera
def test_the_view_plane_goes_through_the_point_and_faces_the_camera(camera):
    point = np.array([0.6, 0.4, 0.3])
    moved = picking.onto_view_plane(camera, (20.0, 90.0), point)
    pixels, _ = picking.project(camera, moved[None])
    assert pixels[0] == pytest.approx([20, 90])
    assert (moved - point) @ camera.forward == pytest.approx(0)


def test_depth_at_reads_an_image_of_fewer_pixels():
    depth = np.arange(12.0).reshape(3, 4)  # 40 x 40 pixels of the camera each
    pixels = np.array([[0.0, 0.0], [159.9, 119.9], [41.0, 81.0], [-1.0, 5.0], [np.nan, 1.0]])
    assert picking.depth_at(depth, CAMERA, pixels).tolist() == [0, 11, 9, np.inf, np.inf]


def test_hidden_is_what_lies_deeper_than_the_bias():
    depth = np.full((120, 160), 2.5, np.float32)
    points = np.array([picking.point_at(CAMERA, (80, 60), t) for t in (2.4, 2.52, 2.6)])
    assert picking.visible(CAMERA, points, depth, 0.05).tolist() == [True, True, False]


def test_the_nearest_sphere_that_shows_is_picked():
    points = np.array([picking.point_at(CAMERA, (80, 60), t) for t in (3.0, 2.0, 1.5)])
    pick = partial(picking.pick_sphere, CAMERA, (80, 60), points, 0.02, 2.0)
    assert pick() == 2
    surface = np.full((120, 160), 1.7, np.float32)
    assert pick(surface, 0.0) == 2
    surface[:] = 1.4  # before all of them
    assert pick(surface, 0.05) is None and pick(surface, 0.2) == 2


@pytest.mark.parametrize("parallel", [False, True])
def test_a_miss_within_the_slack_counts(parallel):
    camera = replace(CAMERA, parallel=parallel)
    point = picking.onto_view_plane(camera, (80, 60), [0.5, 0.5, 0.5])
    radius = 0.02
    edge = 200.0 * radius / (1.0 if parallel else np.linalg.norm(point - camera.position))
    for beside, hit in [(edge + 4.0, 0), (edge + 6.0, None)]:
        pixel = (80 + beside, 60)
        assert picking.pick_sphere(camera, pixel, point[None], radius, 5.0) == hit
