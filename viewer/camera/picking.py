"""Picks spheres under a pixel, projects points, and finds the points in sight.

Pixels are the image's: x to the right, y down, the center of the first one at (½, ½).
t is the distance along a pixel's unit ray, as in the depth image: from the eye, or, where rays
are parallel, from the plane that they start in.
"""

import numpy as np

from ...core.render import Camera


def project(camera: Camera, points):
    """Pixels [N, 2] and distances t [N] of points [N, 3]; NaN and -inf behind the camera."""
    offsets = np.asarray(points, float) - camera.position
    local = offsets @ camera.camera_to_world[:3, :3]
    in_front = local[:, 2] < -1e-9
    depth = np.where(in_front, -local[:, 2], np.nan)
    (cx, cy), scale = camera.lens.center, pixels_per_unit(camera, depth)
    pixels = np.stack([cx + scale * local[:, 0], cy - scale * local[:, 1]], axis=1)
    pixels[~in_front] = np.nan
    t = depth if camera.parallel else np.linalg.norm(offsets, axis=1)
    return pixels, np.where(in_front, t, -np.inf)


def pixels_per_unit(camera: Camera, depth):
    """How many pixels a unit across the axis of view takes at a depth along it."""
    return camera.focal if camera.parallel else camera.focal / depth


def ray(camera: Camera, pixel):
    """The ray through one pixel: where it starts and its unit direction, [3] each."""
    cx, cy = camera.lens.center
    x, y = (pixel[0] - cx) / camera.focal, (cy - pixel[1]) / camera.focal
    turn = camera.camera_to_world[:3, :3]
    if camera.parallel:
        return camera.position + turn @ np.array([x, y, 0.0]), camera.forward
    direction = turn @ np.array([x, y, -1.0])
    return camera.position, direction / np.linalg.norm(direction)


def point_at(camera: Camera, pixel, t: float):
    """The point at a distance on the ray through one pixel.  [3]"""
    start, direction = ray(camera, pixel)
    return start + t * direction


def onto_view_plane(camera: Camera, pixel, point):
    """The point under `pixel` in the plane through `point` that faces the camera.  [3]"""
    start, direction = ray(camera, pixel)
    depth = (np.asarray(point) - camera.position) @ camera.forward
    return start + direction * (depth / (direction @ camera.forward))


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


def pick_sphere(
    camera: Camera, pixel, centers, radius: float, slack: float, depth_image=None, bias=0.0
) -> int | None:
    """The index of the sphere under a pixel, the nearest to the eye of those that show there.

    A sphere shows where its surface, `bias` nearer to the eye than it is, is before the depth
    image's: as HandleLayer draws it.

    Args:
        centers, radius: Of the spheres, model units.  [N, 3], one radius for all
        slack: Pixels by which a pick may miss a sphere; there its nearest edge has to show.
    """
    pixels, t = project(camera, centers)
    reach = pixels_per_unit(camera, np.maximum(t, 1e-9)) * radius  # pixels
    to_pixel = np.asarray(pixel, float) - pixels
    distance = np.hypot(*to_pixel.T)
    covered = _inside(camera, np.nan_to_num(pixels, nan=-1.0)) & (distance <= reach + slack)
    share = np.minimum(reach / np.maximum(distance, 1e-9), 1.0)[:, None]
    nearest = np.where(covered[:, None], pixels + share * to_pixel, 0.0)  # on the sphere's disc
    height = 1.0 - np.minimum(distance / np.maximum(reach, 1e-9), 1.0) ** 2
    t = t - radius * np.sqrt(height)
    if depth_image is not None:
        covered &= t - bias <= depth_at(depth_image, camera, nearest)
    candidates = np.flatnonzero(covered)
    return int(candidates[np.argmin(t[candidates])]) if len(candidates) else None


def away_from_lines(pixels, starts, ends):
    """How far pixels are from the lines between others [pixels].

    Args:
        pixels, starts, ends: Each [2] or [N, 2].

    Returns:
        A number for each.  [N]
    """
    ways, offsets = np.subtract(ends, starts), np.subtract(pixels, starts)
    lengths = np.maximum((ways**2).sum(axis=-1), 1e-12)
    share = np.clip((offsets * ways).sum(axis=-1) / lengths, 0.0, 1.0)
    return np.linalg.norm(offsets - share[..., None] * ways, axis=-1)


def within(pixels, outline):
    """Whether pixels [N, 2] are inside a closed outline [K, 2], by the even-odd rule.  [N] bool"""
    pixels, outline = np.asarray(pixels, float), np.asarray(outline, float)
    inside = np.zeros(len(pixels), bool)
    for (x0, y0), (x1, y1) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        crosses = (y0 > pixels[:, 1]) != (y1 > pixels[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            x = x0 + (pixels[:, 1] - y0) * (x1 - x0) / (y1 - y0)
        inside ^= crosses & (pixels[:, 0] < x)
    return inside
