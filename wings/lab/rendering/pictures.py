"""Views of an object, photographs, and the errors of rendered images.

The expected colors come from `render_rays` of core/definition at random pixels: it tests every
ray against every tet, so a whole image would take minutes.

Shapes: V vertices, N pixels.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ....core.definition.image import render_rays
from ....core.field import TetField
from ....core.render import (
    Camera,
    Renderer,
    RenderOptions,
    camera_rays,
    from_field_of_view,
    in_space,
    look_at,
)
from ....core.training import Dataset, white_composite

FIELD_OF_VIEW = 0.69  # rad, as in NeRF-synthetic
FILLED = 0.95  # extent of the object, relative to the image's half width or height
ELEVATION = 0.3  # rad
FIRST_YAW = 0.52  # rad
PEAK_DB = 100.0  # of equal images; 8-bit images differ by at most about 60 dB


class ExpectedPixels(NamedTuple):
    """A view of a pose, and the expected colors of some of its pixels."""

    camera: Camera  # in model space
    vertices: np.ndarray  # the pose [V, 3] float32
    numbers: np.ndarray  # of the pixels, row by row [N]
    colors: np.ndarray  # over white [N, 3] float64


class PhotoPixels(NamedTuple):
    """Random pixels of a photograph, over white."""

    origins: np.ndarray  # of rays in model space [N, 3]
    directions: np.ndarray  # [N, 3]
    colors: np.ndarray  # [N, 3], 0..1


class Difference(NamedTuple):
    """The error of images against their references."""

    psnr: float  # of all compared pixels [dB], at most PEAK_DB
    largest: float  # difference of a channel [1/255]


def view(field: TetField, yaw: float, size: int) -> Camera:
    """A camera that sees all visible tets of the object at rest, as large as the image."""
    mesh = field.mesh
    seen = field.occupancy != 0
    points = np.unique(mesh.tets[seen if seen.any() else slice(None)])
    points = mesh.rest_vertices[points]
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    flat = np.cos(ELEVATION)
    toward = np.array([np.cos(yaw) * flat, np.sin(yaw) * flat, np.sin(ELEVATION)])
    pose = look_at(center + toward, center)
    right, up = pose[:3, 0], pose[:3, 1]
    # A point is in sight from this distance on: its offset aside over the tangent, plus its
    # offset towards the eye.
    tangent = FILLED * np.tan(0.5 * FIELD_OF_VIEW)
    aside = np.abs((points - center) @ np.stack([right, up], axis=1)) / tangent
    distance = (aside.max(axis=1) + (points - center) @ toward).max()
    pose = look_at(center + distance * toward, center)
    return from_field_of_view(pose, FIELD_OF_VIEW, size, size)


def views(field: TetField, count: int, size: int) -> list[Camera]:
    """Views from all around, of size x size pixels."""
    yaws = FIRST_YAW + 2.0 * np.pi * np.arange(count) / count
    return [view(field, yaw, size) for yaw in yaws]


def random_pixels(camera: Camera, count: int, seed: int):
    """Numbers of at most `count` different pixels of an image, in order.  [N]"""
    every = camera.width * camera.height
    rng = np.random.default_rng(seed)
    return np.sort(rng.choice(every, min(count, every), replace=False))


def expected_pixels(field: TetField, vertices, camera: Camera, numbers) -> ExpectedPixels:
    """The colors that the reference gives these pixels [N]."""
    vertices = np.asarray(vertices, np.float32)
    origins, directions = camera_rays(camera)
    background = RenderOptions().background
    rays = origins[numbers], directions[numbers]
    colors, _, _ = render_rays(field.definition, vertices, *rays, background)
    return ExpectedPixels(camera, vertices, numbers, np.clip(colors, 0.0, 1.0))


def discretization(field: TetField, expected: list[ExpectedPixels], count: int, finer=4):
    """The reference's error, against itself with 1/`finer` of the step, at `count` random pixels.

    The sum converges with order 1 to 2, so its true error is at most a third larger.

    Returns:
        A Difference.
    """
    step = field.options.march_step / finer
    fine = replace(field, options=replace(field.options, march_step=step))
    rng, found, exact = np.random.default_rng(0), [], []
    for mine in expected:
        some = min(count // len(expected), len(mine.numbers))
        some = rng.choice(len(mine.numbers), some, replace=False)
        found.append(mine.colors[some])
        exact.append(expected_pixels(fine, mine.vertices, mine.camera, mine.numbers[some]).colors)
    return image_error(found, exact)


def picture_error(images, expected: list[ExpectedPixels]) -> Difference:
    """The error of rendered images ([H, W, 3] uint8 each) at the expected pixels."""
    found = [
        image.reshape(-1, 3)[mine.numbers] / 255.0
        for image, mine in zip(images, expected, strict=True)
    ]
    return image_error(found, [mine.colors for mine in expected])


def image_error(images, expected) -> Difference:
    """The error of images with values 0..1 against others of the same shapes."""
    off = np.concatenate(
        [np.ravel(np.asarray(a, float) - b) for a, b in zip(images, expected, strict=True)]
    )
    squared = float((off**2).mean())
    psnr = min(-10.0 * np.log10(squared), PEAK_DB) if squared > 0.0 else PEAK_DB
    return Difference(float(psnr), float(255.0 * np.abs(off).max()))


def largest_difference(images, others) -> float:
    """The largest difference of a channel between uint8 images of the same shape [1/255]."""
    return float(np.abs(np.asarray(images, int) - others).max())


def photographs(field: TetField, dataset: Dataset, pixel_count: int) -> list[PhotoPixels]:
    """Draw `pixel_count` random pixels of every view of a data set."""
    found = []
    poses = in_space(dataset.poses, field.world_to_model)
    for number, (pose, lens) in enumerate(zip(poses, dataset.lenses, strict=True)):
        camera = Camera(pose, lens)
        origins, directions = camera_rays(camera)
        some = random_pixels(camera, pixel_count, number)
        colors = white_composite(dataset.image(number)).reshape(-1, 3)
        found.append(PhotoPixels(origins[some], directions[some], colors[some]))
    return found


def photo_psnr(photos: list[PhotoPixels], renderer: Renderer, options: RenderOptions) -> float:
    """PSNR of the model at rest: the mean over the views, as in deformrf eval [dB]."""
    renderer.set_vertices(renderer.field.mesh.rest_vertices)
    found = []
    for photo in photos:
        color, _, _ = renderer.render_rays(photo.origins, photo.directions, options)
        found.append(image_error([np.clip(color, 0.0, 1.0)], [photo.colors]).psnr)
    return float(np.mean(found))
