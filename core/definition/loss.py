"""The loss that training makes small, in both of its stages.

    R rays of a batch; K pieces of one ray, from front to back
    σ, c, h                  of a piece, at a point in it that training draws at random
    δ, t                     length of a piece at rest, and its middle along the ray
    w                        `weights` (image.py) of τ = σδ;  Σw is the opacity
    rgba [R, 4]              what the photograph shows, and its opacity (1 where it has none)
    θ                        the features in the tables of L levels

At rest tets don't overlap, so a pixel is Eq. 1 of the paper.  A batch costs

    mean over rays of (|color − target|²/3 + 10⁻² D + 10⁻⁵ X + λ E) + decay · ½ Σ_l 4^(l+1−L) Σ θ_l²

    color = Σ w c + (1 − Σw) background       target = rgb · alpha + background · (1 − alpha)
    D = Σ_ij w_i w_j |t_i − t_j| + ⅓ Σ_i w_i² δ_i        distortion: Mip-NeRF 360, Eq. 15
    X = Σw · Σ over the three logits of (|logit| − 8)⁺²   excess; 0 without `color_per_ray`
    E = Σ_i w_i (t_K − t_i)   lead; λ = 0 but where a trial asks for more (training/beginnings.py)

The background is white, or random for each ray, so that density in empty space is an error.  X
keeps logits where the sigmoid has a slope; gradients treat its Σw as a constant.

Stage 1 trains the whole grid, with at most four levels and pieces twice as long.  Then tets in
which nothing was seen are removed; in the others, mask bits are 0 where nothing was seen.  Stage 2
trains these tets anew, with all levels.
"""

import numpy as np

from .networks import color_logits, sigmoid

DISTORTION_WEIGHT = 1e-2
EXCESS_WEIGHT = 1e-5
MOST_LOGIT = 8.0  # a color a tenth of 1/255 from 0 or 1
SMALLEST_OPACITY = 1e-3  # the least divisor: a smaller one has hardly a color


def distortion(w, t, length):
    """D of one ray, of w, t and δ [K]."""
    return w @ np.abs(t[:, None] - t) @ w + w**2 @ length / 3.0


def lead(w, t):
    """E of one ray, of w and t [K]."""
    return w @ (t[-1] - t) if len(t) else 0.0


def ray_colors_and_excess(sums, opacity, directions, color_layers):
    """Colors times opacity [R, 3], and X [R], of rays with one color each: Σwh [R, 16], Σw [R]."""
    h = sums / np.maximum(opacity, SMALLEST_OPACITY)[:, None]
    logits = color_logits(h, directions, color_layers)
    excess = opacity * (np.maximum(np.abs(logits) - MOST_LOGIT, 0.0) ** 2).sum(axis=1)
    return opacity[:, None] * sigmoid(logits), excess


def batch_loss(color, opacity, distortions, excess, rgba, background, lead_costs=0.0):
    """The mean over rays.  Colors [R, 3] are without background [R, 3]; X = 0 for samples'."""
    rgb, alpha = rgba[:, :3], rgba[:, 3:]
    target = rgb * alpha + background * (1.0 - alpha)
    error = ((color + (1.0 - opacity)[:, None] * background - target) ** 2).sum(axis=1) / 3.0
    return (error + DISTORTION_WEIGHT * distortions + EXCESS_WEIGHT * excess + lead_costs).mean()


def table_decay(tables, decay):
    """The last term: a feature costs most at the finest level."""
    costs = [4.0**level * (table**2).sum() for level, table in enumerate(tables)]
    return decay * 0.5 * sum(costs) * 4.0 ** (1 - len(tables))
