"""Temporal upsampling: coarse pictures that move become the image, in as many pixels as it has.

A coarse picture's rays go through every n-th pixel of the image, in the next picture through
others (`phases`).  The pixels between them are taken from the image before, moved to where its
surfaces are now (upsampling.py).  The motion is exact under every deformation: a
pixel's surface point lies in a tet, its barycentric coordinates there and the tet's corners of
before say where it was, and the camera of before says which pixel showed it (`place_before`).

The rest is as in temporal antialiasing with upsampling (Yang et al., "A Survey of Temporal
Antialiasing Techniques", CGF 2020).

Shapes: V vertices, T tets, [h, w] of a coarse picture.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import warp as wp

from .rays.camera import Camera, DeviceCamera, camera_ray, device_camera

NOWHERE = wp.constant(-1.0e6)  # column and row outside of every image
FLAT = wp.constant(1.0e-6)  # a tet's volume beside the product of its edges, at least
RECENT = 2.0  # phases after which a pixel has half forgotten that its neighbor was rendered


@cache
def phases(stride: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """The first pixels (column, row) of successive coarse pictures: all of a block of `stride`.

    The next one is as far as possible from those of late, in blocks side by side.
    """
    left = [(x, y) for y in range(stride[1]) for x in range(stride[0])]
    chosen = []

    def crowding(pixel):
        total = 0.0
        for age, other in enumerate(reversed(chosen)):
            away = [abs(a - b) for a, b in zip(pixel, other, strict=True)]
            squared = sum(min(d, n - d) ** 2 for d, n in zip(away, stride, strict=True))
            total += 0.5 ** (age / RECENT) / squared
        return total

    while left:
        chosen.append(min(left, key=crowding))
        left.remove(chosen[-1])
    return tuple(chosen)


def strided(camera: Camera, stride: tuple[int, int], phase: tuple[int, int]) -> Camera:
    """The camera whose rays go through every n-th pixel of `camera`, from the pixel `phase` on.

    The last ones of a row or column may be outside of the image.
    """
    lens = camera.lens
    lens = replace(
        lens,
        width=-(-lens.width // stride[0]),
        height=-(-lens.height // stride[1]),
        focal=(lens.focal[0] / stride[0], lens.focal[1] / stride[1]),
        center=tuple(
            (c - first - 0.5) / n + 0.5
            for c, first, n in zip(lens.center, phase, stride, strict=True)
        ),
    )
    return replace(camera, lens=lens)


@dataclass(frozen=True)
class PastView:
    """What an image was rendered of: a camera without distortion, and vertices [V] on the CPU."""

    camera: Camera
    vertices: wp.array


@wp.struct
class DevicePastView:
    """`PastView` for kernels."""

    world_to_camera: wp.mat44
    focal: wp.vec2
    center: wp.vec2
    parallel: int
    vertices: wp.array(dtype=wp.vec3)


def _for_kernels(sight: PastView) -> DevicePastView:
    value, lens = DevicePastView(), sight.camera.lens
    value.world_to_camera = wp.mat44(np.linalg.inv(sight.camera.camera_to_world))
    value.focal, value.center = wp.vec2(*lens.focal), wp.vec2(*lens.center)
    value.parallel, value.vertices = int(sight.camera.parallel), sight.vertices
    return value


@wp.func
def place_in(sight: DevicePastView, local: wp.vec3):
    """Column and row of a point in camera space, or of a direction there, in pixels."""
    away = wp.where(sight.parallel != 0, 1.0, -local[2])
    place = wp.vec2(NOWHERE, NOWHERE)
    if away > 0.0:
        place = sight.center + wp.cw_mul(sight.focal, wp.vec2(local[0], -local[1])) / away
    return place


@wp.func
def point_before(
    p: wp.vec3, tet: wp.vec4i, now: wp.array(dtype=wp.vec3), before: wp.array(dtype=wp.vec3)
):
    """Where a point of a tet was; nan if the tet is flat now."""
    origin = now[tet[0]]
    a = now[tet[1]] - origin
    b = now[tet[2]] - origin
    c = now[tet[3]] - origin
    d = p - origin
    volume = wp.dot(a, wp.cross(b, c))
    result = wp.vec3(wp.nan, wp.nan, wp.nan)
    if wp.abs(volume) > FLAT * wp.length(a) * wp.length(b) * wp.length(c):
        x = wp.dot(d, wp.cross(b, c)) / volume
        y = wp.dot(a, wp.cross(d, c)) / volume
        z = wp.dot(a, wp.cross(b, d)) / volume
        o = before[tet[0]]
        result = o + x * (before[tet[1]] - o) + y * (before[tet[2]] - o) + z * (before[tet[3]] - o)
    return result


@wp.func
def nearest_beside(
    depth: wp.array2d(dtype=float), tet: wp.array2d(dtype=int), row: int, column: int
):
    """Row and column of the nearest surface in the pixels around one; -1 if there is none."""
    found = wp.vec2i(-1, -1)
    nearest = float(wp.inf)
    k = int(0)
    while k < 9:
        i = row - 1 + k / 3
        j = column - 1 + k % 3
        if i >= 0 and i < depth.shape[0] and j >= 0 and j < depth.shape[1]:
            if depth[i, j] < nearest and tet[i, j] >= 0:
                nearest = depth[i, j]
                found = wp.vec2i(i, j)
        k += 1
    return found


@wp.struct
class Surfaces:
    """What a picture with details shows, and what the image before was rendered of."""

    camera: DeviceCamera
    tets: wp.array(dtype=wp.vec4i)  # [T]
    vertices: wp.array(dtype=wp.vec3)  # [V] now
    color: wp.array2d(dtype=wp.vec4ub)  # [h, w]
    depth: wp.array2d(dtype=float)  # [h, w]
    tet: wp.array2d(dtype=int)  # [h, w]
    before: DevicePastView


def surfaces(image, camera: Camera, renderer, before: PastView) -> Surfaces:
    """For kernels, on the CPU.

    Args:
        image: A whole Image of `camera`, with details, that the renderer has rendered in the pose
            that it has.
    """
    value = Surfaces()
    tets = np.ascontiguousarray(renderer.field.mesh.tets, np.int32)
    value.tets = wp.array(tets, dtype=wp.vec4i, device="cpu", copy=False)
    value.camera, value.before = device_camera(camera), _for_kernels(before)
    value.vertices = renderer.pose.vertices
    value.color, value.depth, value.tet = image.color, image.depth, image.tet
    return value


@wp.func
def place_before(surfaces: Surfaces, row: int, column: int):
    """Where a pixel's surface point was in the image before.

    Column and row in that image, in pixels, and the distances along the rays then and now; these
    are inf where nothing is, column and row NOWHERE if they are not known.  A soft edge, of an
    opacity below ½, moves with the nearest surface beside it.
    """
    before = surfaces.before
    t = surfaces.depth[row, column]
    inside = surfaces.tet[row, column]
    if not wp.isfinite(t) and int(surfaces.color[row, column][3]) > 0:  # the soft edge of something
        beside = nearest_beside(surfaces.depth, surfaces.tet, row, column)
        if beside[0] >= 0:
            t = surfaces.depth[beside[0], beside[1]]
            inside = surfaces.tet[beside[0], beside[1]]
    origin, direction = camera_ray(surfaces.camera, column, row)
    place = wp.vec2(NOWHERE, NOWHERE)
    t_before = t
    if not wp.isfinite(t):  # the background is endlessly far
        if before.parallel != 0:
            place = place_in(before, wp.transform_point(before.world_to_camera, origin))
        else:
            place = place_in(before, wp.transform_vector(before.world_to_camera, direction))
    elif inside >= 0:
        corners = surfaces.tets[inside]
        p = point_before(origin + t * direction, corners, surfaces.vertices, before.vertices)
        if wp.isfinite(p[0]):
            local = wp.transform_point(before.world_to_camera, p)
            place = place_in(before, local)
            t_before = wp.where(before.parallel != 0, -local[2], wp.length(local))
    return wp.vec4(place[0], place[1], t_before, t)
