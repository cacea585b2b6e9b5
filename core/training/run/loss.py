"""The loss of a batch: the error of its rays' colors, and the price of scattered samples.

    loss = mean over rays of (squared error + distortion weight · distortion)

Images with alpha are composited on a random background per ray or on white, so that empty
space learns to be empty.  Where surroundings are learned, `surrounded_cost` is the second term.
"""

import torch

from .batch import Batch
from .surroundings import over, surrounded_cost
from .training_field import TrainingField


def training_loss(field: TrainingField, batch: Batch, white, distortion_weight: float):
    """The loss [] of a marched batch, to be differentiated, and its mean squared error [].

    Rays whose samples didn't fit the batch have no part in them.

    Args:
        white: 1 for a white background, 0 for each ray's random one.  torch [1]
        distortion_weight: Weight of the distortion loss (Mip-NeRF 360, Eq. 15).
    """
    color, opacity, distortion, _ = field.composite(batch)
    target, alpha = batch.rgba[:, :3], batch.rgba[:, 3:]
    cost = distortion_weight * distortion
    if field.surroundings:
        with field.precision():
            front, behind = field.surroundings(
                batch.drawn.origins, batch.drawn.directions, batch.seed, batch.drawn.first
            )
        cost = surrounded_cost(distortion_weight, distortion, opacity, front[1])
        color = over(front, color, opacity, behind)
    else:
        background = torch.maximum(batch.background, white)
        target = target * alpha + background * (1.0 - alpha)
        color = color + (1.0 - opacity[:, None]) * background
    shares = batch.fits / batch.fits.sum().clamp(min=1.0)
    error = (shares[:, None] * (color - target) ** 2).sum() / 3.0
    return error + (shares * cost).sum(), error
