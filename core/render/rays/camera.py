"""The pinhole camera: one convention, stated once.

Camera space is OpenGL's: the camera looks along -z, y is up, x to the right.  Pixel
(column u, row v) has its centre at (u + ½, v + ½); row 0 is the top.  Distances along a
ray are called t and are measured in units of the space that `camera_to_world` maps to.
"""

from dataclasses import dataclass, replace

import numpy as np

from .lens import Lens, lens_rays, pinhole


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Attributes:
        camera_to_world: Rigid pose.  [4, 4] float64
        focal: Focal length in pixels, the same along both axes.
        width, height: Image size in pixels.
    """

    camera_to_world: np.ndarray
    focal: float
    width: int
    height: int

    @property
    def lens(self) -> Lens:
        return pinhole(self.focal, self.width, self.height)

    @property
    def position(self):
        return self.camera_to_world[:3, 3]

    @property
    def forward(self):
        return -self.camera_to_world[:3, 2]

    def resized(self, width: int, height: int) -> "Camera":
        """The same view with another number of pixels; the vertical field of view stays."""
        return replace(self, focal=self.focal * height / self.height, width=width, height=height)


def from_field_of_view(camera_to_world, angle_x: float, width: int, height: int) -> Camera:
    """A camera by its horizontal field of view, in radians."""
    focal = 0.5 * width / np.tan(0.5 * angle_x)
    return Camera(np.asarray(camera_to_world, float), float(focal), width, height)


def look_at(eye, target, up=(0.0, 0.0, 1.0)):
    """The camera-to-world matrix [4, 4] of a camera at `eye` that looks at `target`."""
    eye, target, up = (np.asarray(v, float) for v in (eye, target, up))
    backward = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross(up, backward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(backward, right), backward
    pose[:3, 3] = eye
    return pose


def in_space(poses, matrix):
    """Camera-to-world matrices [..., 4, 4] after a uniform scale and a translation [4, 4].

    Positions are mapped; rotations, and so directions, stay what they are.
    """
    poses = np.array(poses, float)
    poses[..., :3, 3] = poses[..., :3, 3] @ matrix[:3, :3].T + matrix[:3, 3]
    return poses


def camera_rays(camera: Camera):
    """One ray per pixel, row by row.

    Returns:
        origins [H·W, 3] and unit directions [H·W, 3], float64.
    """
    return lens_rays(camera.lens, camera.camera_to_world)


def view_projection(camera: Camera, near: float, far: float):
    """World space to OpenGL clip space.  [4, 4]"""
    projection = np.zeros((4, 4))
    projection[0, 0] = 2.0 * camera.focal / camera.width
    projection[1, 1] = 2.0 * camera.focal / camera.height
    projection[2, 2] = (far + near) / (near - far)
    projection[2, 3] = 2.0 * far * near / (near - far)
    projection[3, 2] = -1.0
    return projection @ np.linalg.inv(camera.camera_to_world)
