"""Picks spheres under a pixel, projects points, and finds the points in sight.

Pixels are the image's: x to the right, y down, the center of the first one at (½, ½).
t is the distance from the eye along a pixel's unit ray, as in the depth image.
"""

import numpy as np

from ..core.render import Camera


def project(camera: Camera, points):
    """Pixels [N, 2] and distances t [N] of points [N, 3]; NaN and -inf behind the camera."""
    offsets = np.asarray(points, float) - camera.position
    local = offsets @ camera.camera_to_world[:3, :3]
    in_front = local[:, 2] < -1e-9
    depth = np.where(in_front, -local[:, 2], np.nan)
    x = 0.5 * camera.width + camera.focal * local[:, 0] / depth
    y = 0.5 * camera.height - camera.focal * local[:, 1] / depth
    t = np.where(in_front, np.linalg.norm(offsets, axis=1), -np.inf)
    return np.stack([x, y], axis=1), t


def ray_direction(camera: Camera, pixel):
    """The unit direction through one pixel.  [3]"""
    x = (pixel[0] - 0.5 * camera.width) / camera.focal
    y = (0.5 * camera.height - pixel[1]) / camera.focal
    direction = camera.camera_to_world[:3, :3] @ np.array([x, y, -1.0])
    return direction / np.linalg.norm(direction)


def onto_view_plane(camera: Camera, pixel, point):
    """The point under `pixel` in the plane through `point` that faces the camera.  [3]"""
    direction = ray_direction(camera, pixel)
    depth = (np.asarray(point) - camera.position) @ camera.forward
    return camera.position + direction * (depth / (direction @ camera.forward))


def depth_at(depth_image, camera: Camera, pixels):
    """The depth at pixels [N, 2] of `camera`; inf outside the image.  [N]

    The depth image [h, w] is of the same view, but may have fewer pixels than the camera.
    """
    height, width = depth_image.shape
    scale = np.array([width / camera.width, height / camera.height])
    inside = _inside(camera, pixels)
    columns, rows = (np.where(inside[:, None], pixels, 0.0) * scale).astype(int).T
    nearest = depth_image[np.minimum(rows, height - 1), np.minimum(columns, width - 1)]
    return np.where(inside, nearest, np.inf)


def visible(camera: Camera, points, depth_image, bias: float):
    """Whether points are in the image and at most `bias` behind the surface.  [N] bool"""
    pixels, t = project(camera, points)
    inside = _inside(camera, pixels)
    if depth_image is None:
        return inside
    return inside & (t - bias <= depth_at(depth_image, camera, pixels))


def _inside(camera, pixels):
    return ((pixels >= 0) & (pixels < [camera.width, camera.height])).all(axis=1)


def pick_sphere(camera: Camera, pixel, centers, radius: float, shown, slack: float) -> int | None:
    """The index of the sphere under a pixel, the nearest to the eye of those that cover it.

    Args:
        centers, radius: Of the spheres, model units.  [N, 3], one radius for all
        shown: Spheres that can be picked.  [N] bool
        slack: Pixels by which a pick may miss a sphere.
    """
    pixels, t = project(camera, centers)
    reach = camera.focal * radius / np.maximum(t, 1e-9) + slack
    distance = np.hypot(*(pixels - np.asarray(pixel, float)).T)
    candidates = np.flatnonzero(shown & (distance <= reach))
    return int(candidates[np.argmin(t[candidates])]) if len(candidates) else None
