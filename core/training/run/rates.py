"""Learning rates: how they fall over the steps of a stage, and which weights have smaller ones."""

from itertools import groupby
from math import cos, pi

from .training_field import TrainingField

FULL_RATE_WIDTH = 64  # of hidden layers that learn as fast as the rest


def learning_rate(step: int, step_count: int, highest: float, final_rate: float) -> float:
    """Adam's learning rate at a step: cosine decay to final_rate · highest.

    `LossWatch.rate_share` multiplies it: a warm-up, and half after each return.
    """
    fall = 0.5 * (1.0 + cos(pi * step / step_count))
    return highest * (final_rate + (1.0 - final_rate) * fall)


def rate_groups(field: TrainingField, parameters) -> list:
    """Parameters side by side with one learning rate: its share of the highest, and they.

    Adam moves every weight equally far.  In wide layers that moves the sums further: an object of
    one color drove layers of 256 to colors of 0 and 1 within 26 steps.  So their rate falls with
    their width.
    """
    color = {id(weights) for weights in field.networks.color.parameters()}
    share = min(1.0, FULL_RATE_WIDTH / max(field.options.color_hidden, default=1))
    groups = groupby(parameters, key=lambda weights: id(weights) in color)
    return [(share if is_color else 1.0, list(some)) for is_color, some in groups]
