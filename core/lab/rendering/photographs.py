"""Pixels of photographs that a model hasn't seen, and what it shows there.

Shapes: N pixels.
"""

from dataclasses import dataclass

import numpy as np

from ...field import TetField
from ...render import Camera, Renderer, RenderOptions, camera_rays, in_space
from ...training import Dataset, white_composite
from .pictures import image_error


@dataclass(frozen=True)
class Photographs:
    """Random pixels of some views, over white.

    Attributes:
        views: Which view each is of.  [N] int
        origins, directions: Rays in model space.  [N, 3]
        colors: [N, 3], 0..1
    """

    views: np.ndarray
    origins: np.ndarray
    directions: np.ndarray
    colors: np.ndarray

    @property
    def view_count(self) -> int:
        """Of how many views there are pixels."""
        return len(np.unique(self.views))

    def psnr(self, renderer: Renderer, options: RenderOptions) -> float:
        """Of the model at rest: the mean of the views' own, as deformrf-eval has it [dB]."""
        renderer.set_vertices(renderer.field.mesh.rest_vertices)
        color, _, _ = renderer.render_rays(self.origins, self.directions, options)
        color = np.clip(color, 0.0, 1.0)
        of_views = [self.views == view for view in np.unique(self.views)]
        return float(np.mean([image_error([color[v]], [self.colors[v]]).psnr for v in of_views]))


def photographs(field: TetField, dataset: Dataset, pixel_count: int, seed=0) -> Photographs:
    """Draw so many pixels of every view."""
    rng = np.random.default_rng(seed)
    poses = in_space(dataset.poses, field.world_to_model)
    parts = []
    for view, (pose, lens) in enumerate(zip(poses, dataset.lenses, strict=True)):
        origins, directions = camera_rays(Camera(pose, lens))
        some = rng.choice(len(origins), min(pixel_count, len(origins)), replace=False)
        colors = white_composite(dataset.image(view)).reshape(-1, 3)
        parts.append((np.full(len(some), view), origins[some], directions[some], colors[some]))
    return Photographs(*(np.concatenate(column) for column in zip(*parts, strict=True)))
