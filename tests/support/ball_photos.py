"""Photographs that a test makes: a ball in a world of two colors, without alpha."""

import numpy as np
from image_datasets import from_images

from deformrf.core.render import Camera, camera_rays, look_at, pinhole


def photographs(count=12, size=20):
    """A red ball of radius 0.4, far before a world that is blue above and green below."""
    images, poses, lens = [], [], pinhole(1.4 * size, size, size)
    for angle in np.linspace(0, 2 * np.pi, count, endpoint=False):
        pose = look_at((4 * np.cos(angle), 4 * np.sin(angle), 0.5), (0, 0, 0))
        origins, directions = camera_rays(Camera(pose, lens))
        b = np.einsum("ij,ij->i", origins, directions)
        hit = b**2 - ((origins**2).sum(axis=1) - 0.4**2) > 0
        color = np.where(directions[:, 2:] > -0.1, [[60, 80, 220]], [[40, 160, 60]])
        color = np.where(hit[:, None], [[220, 40, 30]], color)
        rgba = np.column_stack([color, np.full(len(color), 255)])
        images.append(rgba.reshape(size, size, 4).astype(np.uint8))
        poses.append(pose)
    return from_images(images, poses, [lens] * count, [str(i) for i in range(count)], "train")
