"""All training pixels as rays on one device, drawn at random.

Rays are in model space: the data's cameras moved by `world_to_model`, a uniform scale
and a translation, so directions stay what they are.
"""

import numpy as np
import torch

from ..render.camera import in_space
from .datasets import Dataset


def scene_to_unit_cube(radius: float):
    """The box [-radius, radius]³ to the unit cube.  [4, 4]"""
    matrix = np.eye(4) * (0.5 / radius)
    matrix[:3, 3] = 0.5
    matrix[3, 3] = 1.0
    return matrix


class RayBank:
    """Draws random pixels of a data set as rays with their straight-alpha color."""

    def __init__(self, dataset: Dataset, world_to_model, device, seed=0):
        self.images = torch.from_numpy(dataset.images.reshape(-1, 4)).to(device)
        self.poses = torch.from_numpy(
            in_space(dataset.poses, world_to_model).astype(np.float32)
        ).to(device)
        self.width, self.height, self.focal = dataset.width, dataset.height, dataset.focal
        self.generator = torch.Generator(device=device).manual_seed(seed)

    @property
    def pixel_count(self) -> int:
        return len(self.images)

    def draw(self, count: int):
        """Random rays.

        Returns:
            origins [R, 3], directions [R, 3] and RGBA in 0..1 [R, 4].
        """
        pixel = torch.randint(
            self.pixel_count, (count,), generator=self.generator, device=self.images.device
        )
        return self.rays(pixel)

    def rays(self, pixel):
        """The rays of given pixels, numbered view by view, row by row.  [R] int64"""
        per_view = self.width * self.height
        pose = self.poses[pixel // per_view]
        u = (pixel % self.width).float() + 0.5
        v = ((pixel % per_view) // self.width).float() + 0.5
        x = (u - 0.5 * self.width) / self.focal
        y = (0.5 * self.height - v) / self.focal
        local = torch.stack([x, y, -torch.ones_like(x)], dim=1)
        directions = torch.einsum("rij,rj->ri", pose[:, :3, :3], local)
        directions = torch.nn.functional.normalize(directions, dim=1)
        return pose[:, :3, 3].contiguous(), directions, self.images[pixel].float() / 255.0
