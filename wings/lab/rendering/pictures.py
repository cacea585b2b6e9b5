"""Views of an object, photographs, and the errors of rendered images.

The expected colors come from the float64 reference (render/reference.py) at random pixels: it
tests every ray against every tet, so a whole image would take minutes.  The reference's own
error against the integral is measured with a quarter of its step (`discretization`).

Shapes: V vertices, N pixels.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ....core.field import TetField
from ....core.render import (
    Camera,
    Renderer,
    RenderOptions,
    camera_rays,
    from_field_of_view,
    in_space,
    look_at,
    reference,
)
from ....core.training import Dataset, white_composite

FIELD_OF_VIEW = 0.69  # rad, as in NeRF-synthetic
FILLED = 0.95  # extent of the object, relative to the image's half width or height
ELEVATION = 0.3  # rad
FIRST_YAW = 0.52  # rad
PEAK_DB = 100.0  # of equal images; 8-bit images differ by at most about 60 dB


@dataclass(frozen=True)
class Picture:
    """A view of a pose, and the expected colors of some of its pixels."""

    camera: Camera  # in model space
    vertices: np.ndarray  # the pose [V, 3] float32
    pixels: np.ndarray  # numbers of the pixels, row by row [N]
    expected: np.ndarray  # their colors over white [N, 3] float64


@dataclass(frozen=True)
class ImageError:
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


def picture(field: TetField, vertices, camera: Camera, pixel_count: int, seed=0) -> Picture:
    """A view with the expected colors of random pixels."""
    all_pixels = camera.width * camera.height
    rng = np.random.default_rng(seed)
    pixels = rng.choice(all_pixels, min(pixel_count, all_pixels), replace=False)
    return picture_of(field, vertices, camera, np.sort(pixels))


def picture_of(field: TetField, vertices, camera: Camera, pixels) -> Picture:
    """A view with the expected colors of these pixels [N]."""
    vertices = np.asarray(vertices, np.float32)
    return Picture(camera, vertices, pixels, _expected(field, vertices, camera, pixels))


def discretization(field: TetField, pictures: list[Picture], count: int, part=4) -> ImageError:
    """The reference's error, against itself with 1/`part` of the step, at `count` random pixels.

    The sum converges with order 1 to 2, so its true error is at most a third larger.
    """
    step = field.options.march_step / part
    finer = replace(field, options=replace(field.options, march_step=step))
    rng, found, expected = np.random.default_rng(0), [], []
    for picture in pictures:
        shown = min(count // len(pictures), len(picture.pixels))
        some = rng.choice(len(picture.pixels), shown, replace=False)
        found.append(picture.expected[some])
        expected.append(_expected(finer, picture.vertices, picture.camera, picture.pixels[some]))
    return image_error(found, expected)


def picture_error(images, pictures: list[Picture]) -> ImageError:
    """The error of rendered images ([H, W, 3] uint8 each) of these pictures."""
    found = [
        image.reshape(-1, 3)[picture.pixels] / 255.0
        for image, picture in zip(images, pictures, strict=True)
    ]
    return image_error(found, [picture.expected for picture in pictures])


def image_error(images, expected) -> ImageError:
    """The error of images with values 0..1 against others of the same shapes."""
    off = np.concatenate(
        [np.ravel(np.asarray(a, float) - b) for a, b in zip(images, expected, strict=True)]
    )
    squared = float((off**2).mean())
    psnr = min(-10.0 * np.log10(squared), PEAK_DB) if squared > 0.0 else PEAK_DB
    return ImageError(float(psnr), float(255.0 * np.abs(off).max()))


def differences(images, others):
    """Error of each pixel's worst channel [1/255], for uint8 [..., 3].  [...]"""
    return np.abs(images.astype(int) - others).max(axis=-1)


def _expected(field, vertices, camera, pixels):
    origins, directions = camera_rays(camera)
    color, _, _ = reference.render_rays(
        field, vertices, origins[pixels], directions[pixels], RenderOptions().background
    )
    return np.clip(color, 0.0, 1.0)


class Photograph(NamedTuple):
    """Random pixels of a photograph, over white."""

    origins: np.ndarray  # of rays in model space [N, 3]
    directions: np.ndarray  # [N, 3]
    colors: np.ndarray  # [N, 3], 0..1


def photographs(field: TetField, dataset: Dataset, pixel_count: int, seed=0) -> list[Photograph]:
    """Draw `pixel_count` random pixels of every view of a data set."""
    rng, found = np.random.default_rng(seed), []
    poses = in_space(dataset.poses, field.world_to_model)
    for view, (pose, lens) in enumerate(zip(poses, dataset.lenses, strict=True)):
        origins, directions = camera_rays(Camera(pose, lens))
        some = rng.choice(len(origins), min(pixel_count, len(origins)), replace=False)
        colors = white_composite(dataset.image(view)).reshape(-1, 3)
        found.append(Photograph(origins[some], directions[some], colors[some]))
    return found


def photo_psnr(photos: list[Photograph], renderer: Renderer, options: RenderOptions) -> float:
    """PSNR of the model at rest: the mean over the views, as in deformrf-eval [dB]."""
    renderer.set_vertices(renderer.field.mesh.rest_vertices)
    found = []
    for photo in photos:
        color, _, _ = renderer.render_rays(photo.origins, photo.directions, options)
        found.append(image_error([np.clip(color, 0.0, 1.0)], [photo.colors]).psnr)
    return float(np.mean(found))
