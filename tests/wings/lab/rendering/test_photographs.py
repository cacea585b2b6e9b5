"""A model is at its best against photographs of itself."""

from dataclasses import replace

import numpy as np
import pytest
from image_datasets import from_images

from deformrf.core.render import Camera, Renderer, RenderOptions, pinhole
from deformrf.wings.lab.rendering import pictures
from deformrf.wings.lab.rendering.pictures import photo_psnr, photographs

SIZES = ((20, 20), (24, 16), (16, 24))


def dataset_of(field, device="cpu"):
    """What the model shows, from all around, in images of several sizes."""
    renderer = Renderer(field, device)
    renderer.set_vertices(field.mesh.rest_vertices)
    poses = [camera.camera_to_world for camera in pictures.views(field, len(SIZES), 20)]
    lenses = [pinhole(30.0, width, height) for width, height in SIZES]
    images = [
        renderer.render(Camera(*both)).color_array().copy()
        for both in zip(poses, lenses, strict=True)
    ]
    for image in images:
        image[..., 3] = 255  # it is over white as it is
    return from_images(images, poses, lenses, ["a", "b", "c"], "test")


def test_a_model_is_what_it_shows(ball, device):
    dataset, renderer = dataset_of(ball, device), Renderer(ball, device)
    assert photo_psnr(photographs(ball, dataset, 200), renderer, RenderOptions()) > 45.0
    negative = replace(dataset, pixels=dataset.pixels ^ np.uint8([255, 255, 255, 0]))
    assert photo_psnr(photographs(ball, negative, 200), renderer, RenderOptions()) < 15.0


def test_it_is_the_model_at_rest(ball):
    """Whatever pose was rendered before."""
    renderer = Renderer(ball)
    renderer.set_vertices(ball.mesh.rest_vertices + 0.3)
    photos = photographs(ball, dataset_of(ball), 200)
    assert photo_psnr(photos, renderer, RenderOptions()) > 45.0


def test_options_are_those_that_are_rendered(ball):
    photos, renderer = photographs(ball, dataset_of(ball), 200), Renderer(ball)
    assert photo_psnr(photos, renderer, RenderOptions(level_count=1)) < 40.0


def test_poses_are_taken_to_model_space(ball):
    """The same photographs, in a world that is larger and lies elsewhere."""
    larger = np.diag([2.0, 2.0, 2.0, 1.0])
    larger[:3, 3] = 1.0, -2.0, 3.0
    dataset = dataset_of(ball)
    there = np.array(dataset.poses)
    there[:, :3, 3] = 2.0 * there[:, :3, 3] + larger[:3, 3]
    field = replace(ball, world_to_model=np.linalg.inv(larger))
    photos = photographs(field, replace(dataset, poses=there), 200)
    assert photo_psnr(photos, Renderer(field), RenderOptions()) > 45.0
    lost = photographs(ball, replace(dataset, poses=there), 200)
    assert photo_psnr(lost, Renderer(ball), RenderOptions()) < 30.0


def test_what_is_transparent_is_white(ball):
    image = np.random.default_rng().integers(256, size=(8, 8, 4), dtype=np.uint8)
    image[:4, :, 3], image[4:, :, 3] = 0, 255
    pose = pictures.view(ball, 0.0, 8).camera_to_world
    dataset = from_images([image], [pose], [pinhole(9.0, 8, 8)], ["a"], "test")
    colors = photographs(ball, dataset, 64)[0].colors
    white = (colors == 1.0).all(axis=1)
    assert white.sum() == 32
    opaque = np.unique(np.round(255.0 * colors[~white]).astype(int), axis=0)
    np.testing.assert_array_equal(opaque, np.unique(image[4:, :, :3].reshape(-1, 3), axis=0))


@pytest.mark.parametrize("asked, found", [(50, 150), (390, 1158), (1000, 1168)])
def test_so_many_pixels_of_every_view(ball, asked, found):
    """None twice, and no more than there are."""
    dataset = dataset_of(ball)
    photos = photographs(ball, dataset, asked)
    assert len(photos) == 3
    origins, directions, colors = (np.concatenate(arrays) for arrays in zip(*photos, strict=True))
    assert origins.shape == directions.shape == colors.shape == (found, 3)
    rays = np.concatenate([origins, directions], axis=1)
    assert len(np.unique(rays, axis=0)) == found
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    again = photographs(ball, dataset, asked)
    np.testing.assert_array_equal(np.concatenate([photo.colors for photo in again]), colors)


def test_the_psnr_is_the_mean_of_the_views(ball):
    """One view that is all wrong costs its share of decibels, and no more."""
    dataset, renderer = dataset_of(ball), Renderer(ball)
    whole = photographs(ball, dataset, 200)
    single = [photo_psnr([photo], renderer, RenderOptions()) for photo in whole]
    assert photo_psnr(whole, renderer, RenderOptions()) == pytest.approx(np.mean(single))
    whole[1] = whole[1]._replace(colors=1.0 - whole[1].colors)
    wrong = photo_psnr(whole, renderer, RenderOptions())
    assert np.mean(single) / 3 < wrong < np.mean(single) - 5.0
