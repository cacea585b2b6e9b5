"""The camera: a pose and a lens, and the ray of each pixel.

Camera space is OpenGL's: the camera looks along -z, y is up, x to the right.  Pixel
(column u, row v) has its center at (u + ½, v + ½); row 0 is the top.  Distances along a
ray are called t and are measured in units of the space that `camera_to_world` maps to.

Rays of a pinhole camera start at its position.  Those of a parallel (orthographic) camera look
along -z and start in the plane through its position: its focal lengths are pixels per unit.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from .lens import DeviceLens, Lens, device_lens, lens_direction, pinhole, undistort

wp.set_module_options({"enable_backward": False})


@dataclass(frozen=True)
class Camera:
    """A lens with a pose.

    Attributes:
        width, height: Of the image.
        focal: The horizontal focal length in pixels (or pixels per unit, if rays are parallel).
        position, forward: [3]
    """

    camera_to_world: np.ndarray  # [4, 4] float64: rigid, OpenGL's axes
    lens: Lens
    parallel: bool = False
    # What follows from these, so that nothing has to be called for it.
    width: int = field(init=False, repr=False, compare=False)
    height: int = field(init=False, repr=False, compare=False)
    focal: float = field(init=False, repr=False, compare=False)
    position: np.ndarray = field(init=False, repr=False, compare=False)
    forward: np.ndarray = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        lens, pose = self.lens, self.camera_to_world
        vars(self).update(width=lens.width, height=lens.height, focal=lens.focal[0])
        vars(self).update(position=pose[:3, 3], forward=-pose[:3, 2])

    def resized(self, width: int, height: int) -> "Camera":
        """The same camera with another number of pixels; the vertical field of view stays.

        Pixels keep their shape: a wider image shows more at its sides.
        """
        lens, scale = self.lens, height / self.height
        lens = replace(
            lens,
            width=width,
            height=height,
            # Not times `scale`: in this order, images keep the bits of earlier versions.
            focal=(lens.focal[0] * height / lens.height, lens.focal[1] * height / lens.height),
            center=(
                0.5 * width + (lens.center[0] - 0.5 * lens.width) * scale,
                0.5 * height + (lens.center[1] - 0.5 * lens.height) * scale,
            ),
        )
        return replace(self, lens=lens)


def from_field_of_view(
    camera_to_world: ArrayLike, angle_x: float, width: int, height: int
) -> Camera:
    """A pinhole camera by its horizontal field of view, in radians."""
    focal = 0.5 * width / np.tan(0.5 * angle_x)
    return Camera(np.asarray(camera_to_world, float), pinhole(float(focal), width, height))


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> np.ndarray:
    """The camera-to-world matrix [4, 4] of a camera at `eye` that looks at `target`."""
    eye, target, up = (np.asarray(v, float) for v in (eye, target, up))
    backward = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross(up, backward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(backward, right), backward
    pose[:3, 3] = eye
    return pose


def in_space(poses: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Camera-to-world matrices [..., 4, 4] after a similarity [4, 4]: positions and axes turn.

    Without a rotation in it the axes stay what they are, bit for bit.
    """
    poses, linear = np.array(poses, float), matrix[:3, :3]
    if (linear != np.diag(np.diag(linear))).any():
        poses[..., :3, :3] = linear / np.cbrt(np.linalg.det(linear)) @ poses[..., :3, :3]
    poses[..., :3, 3] = poses[..., :3, 3] @ matrix[:3, :3].T + matrix[:3, 3]
    return poses


def view_projection(camera: Camera, near: float, far: float) -> np.ndarray:
    """World space to OpenGL clip space, without the lens's distortion.  [4, 4]"""
    (fx, fy), (cx, cy) = camera.lens.focal, camera.lens.center
    x, y = 2.0 * cx / camera.width - 1.0, 1.0 - 2.0 * cy / camera.height  # of the axis
    if camera.parallel:
        projection = [
            [2.0 * fx / camera.width, 0.0, 0.0, x],
            [0.0, 2.0 * fy / camera.height, 0.0, y],
            [0.0, 0.0, 2.0 / (near - far), (far + near) / (near - far)],
            [0.0, 0.0, 0.0, 1.0],
        ]
        return np.array(projection) @ np.linalg.inv(camera.camera_to_world)
    projection = [
        [2.0 * fx / camera.width, 0.0, -x, 0.0],
        [0.0, 2.0 * fy / camera.height, -y, 0.0],
        [0.0, 0.0, (far + near) / (near - far), 2.0 * far * near / (near - far)],
        [0.0, 0.0, -1.0, 0.0],
    ]
    return np.array(projection) @ np.linalg.inv(camera.camera_to_world)


def camera_rays(
    camera: Camera, first_pixel: int = 0, count: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """One ray per pixel, row by row: origins and unit directions, each [H·W, 3] float64.

    Or those of the pixels first_pixel, first_pixel + 1, ...: [count, 3]
    """
    lens, camera_to_world = camera.lens, np.asarray(camera.camera_to_world, float)
    pixels = np.arange(first_pixel, first_pixel + (count or lens.width * lens.height))
    u, v = pixels % lens.width + 0.5, pixels // lens.width + 0.5
    x, y = undistort(
        lens, (u - lens.center[0]) / lens.focal[0], (v - lens.center[1]) / lens.focal[1]
    )
    local = np.stack([x, -y, -np.ones_like(x)], axis=-1)
    if camera.parallel:
        aside = local * [1.0, 1.0, 0.0] @ camera_to_world[:3, :3].T
        return camera_to_world[:3, 3] + aside, np.broadcast_to(camera.forward, aside.shape)
    directions = local @ camera_to_world[:3, :3].T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.broadcast_to(camera_to_world[:3, 3], directions.shape), directions


@wp.struct
class DeviceCamera:
    """`Camera` for kernels."""

    camera_to_world: wp.mat44
    lens: DeviceLens
    parallel: int


def device_camera(camera: Camera) -> DeviceCamera:
    value = DeviceCamera()
    value.camera_to_world = wp.mat44(camera.camera_to_world)
    value.lens = device_lens(camera.lens)
    value.parallel = int(camera.parallel)
    return value


@wp.func
def camera_ray(camera: DeviceCamera, column: int, row: int):
    """`camera_rays` on the device: a pixel's origin and unit direction."""
    pose = camera.camera_to_world
    d = lens_direction(camera.lens, column, row)
    origin = wp.vec3(pose[0, 3], pose[1, 3], pose[2, 3])
    if camera.parallel != 0:
        origin += wp.transform_vector(pose, wp.vec3(-d[0] / d[2], -d[1] / d[2], 0.0))
        d = wp.vec3(0.0, 0.0, -1.0)
    return origin, wp.normalize(wp.transform_vector(pose, d))


@wp.kernel
def camera_rays_kernel(
    camera: DeviceCamera,
    first_pixel: int,
    origins: wp.array(dtype=wp.vec3),  # out
    directions: wp.array(dtype=wp.vec3),  # out
):
    """The rays of the pixels first_pixel, first_pixel + 1, ..., counted row by row."""
    i = wp.tid()
    pixel = first_pixel + i
    origin, direction = camera_ray(camera, pixel % camera.lens.width, pixel / camera.lens.width)
    origins[i] = origin
    directions[i] = direction
