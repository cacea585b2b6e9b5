"""The loss of a batch: that of definition/loss.py, and additional terms for photographs.

If surroundings are trained, `surrounded_cost` takes the place of the distortion's cost.  If
photographs differ in exposure, each has a color map (exposure.py), which is applied to the model's
colors before they are compared; the maps have a cost, too.  Where masks don't tell the object, what
stood still is behind it (plates.py).

Excess is a cost on a color's logits beyond ±8.  An object of one color drives a wide network there
in the first steps, and then no error changes its colors again.  Every color that 8 bits can tell
from 0 and 1 lies within ±8.  Colors of samples and of surroundings have no such cost, because their
networks are narrow.

Table decay reduces noise: fine levels also fit differences between photographs that are not
texture.  It is a normal prior of the features (Bishop 2006, Eq. 1.67).  The error is a mean over
pixels, the decay a sum over features, so a prior's weight is divided by the number of pixels.  Only
the gradient of this term is computed: `add_table_decay`.
"""

import torch

from ...definition.loss import EXCESS_WEIGHT
from .batch import Batch
from .sample_limits import SampleLimits
from .surroundings import over, surrounded_cost
from .training_field import TrainingField


def training_loss(
    field: TrainingField,
    batch: Batch,
    white,
    distortion_weight: float,
    limits: SampleLimits | None = None,
    depth_weight=None,
):
    """The loss [] of a marched batch, to be differentiated, and its mean squared error [].

    Rays whose samples didn't fit the batch, or that used their limit up too early, are left out of
    them.  The means are over all pixels that were tried for the others, see Drawn.tries.

    Args:
        white: 1 for a white background, 0 for each ray's random one.  torch [1]
        distortion_weight: Weight of the distortion loss (Mip-NeRF 360, Eq. 15).
        limits: Learn from the batch how many samples its rays need.  They set its `fits` to 0 for
            the rays that they leave out, and what they learn has to be kept: see `keep` there.
        depth_weight: Weight of the lead, without surroundings; None: 0.  torch [1]
    """
    color, opacity, distortion, lead, _, visible, excess = field.composite(batch)
    if limits is not None:
        limits.judge(batch, opacity, visible)
    target, alpha = batch.rgba[:, :3], batch.rgba[:, 3:]
    cost = distortion_weight * distortion
    if depth_weight is not None:
        cost = cost + depth_weight * lead
    if field.surroundings:
        with field.precision():
            front, behind = field.surroundings(
                batch.drawn.origins, batch.drawn.directions, batch.seed, batch.drawn.first
            )
        cost = surrounded_cost(distortion_weight, distortion, opacity, front[1])
        color = over(front, color, opacity, behind)
        opacity = torch.ones_like(opacity)
    if field.plates is not None:
        plate, untold = field.plates(batch.pixels)
        behind = untold * (1.0 - opacity)
        color, opacity = color + behind[:, None] * plate, opacity + behind
        alpha = torch.maximum(alpha, untold[:, None])
    if field.exposure is not None:
        color = field.exposure(color, opacity, batch.views)
    if not field.surroundings:
        background = torch.maximum(batch.background, white)
        target = target * alpha + background * (1.0 - alpha)
        color = color + (1.0 - opacity[:, None]) * background
    cost = cost + EXCESS_WEIGHT * excess
    shares = batch.fits / batch.pixels_tried().clamp(min=1.0)
    error = (shares[:, None] * (color - target) ** 2).sum() / 3.0
    loss = error + (shares * cost).sum()
    return loss if field.exposure is None else loss + field.exposure.cost(), error


@torch.no_grad()
def add_table_decay(gradient, field: TrainingField, weight: float):
    """Add the gradient of the table's decay to `gradient`.  [entries, F]"""
    entries, offsets = field.entries(), field.layout.offsets
    level_count = field.layout.level_count
    for level in range(level_count):
        of_level = slice(offsets[level], offsets[level + 1])
        gradient[of_level].add_(entries[of_level], alpha=weight * 4.0 ** (level + 1 - level_count))
