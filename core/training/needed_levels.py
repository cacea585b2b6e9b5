"""How many levels images need: a model's finest ones may hold nothing that a pixel shows.

Decay takes features to 0 that photographs don't teach.  Where it is strong, or where the finest
edges are far shorter than a pixel, those of whole levels stay near 0.  Such a level is a third of
a model's file and costs time in each frame, so it is left out when training is over.

A level is needed if without it, and all finer ones, the object's pixels change by more, in root
mean square, than rounding to bytes does.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from ..field import FEATURES
from .data.raybank import RayBank
from .run.batch import Batch, looks
from .run.memory import within_memory
from .run.training_field import LOOK_RAYS, SMALLEST_LOOK, TrainingField

ROUNDING = 1.0 / (255.0 * 12.0**0.5)  # to bytes, in root mean square: colors are 0 to 1
SEEN = 1.0 / 255.0  # the least opacity of a pixel of the object


@torch.no_grad()
def needed_levels(field: TrainingField, bank: RayBank) -> int:
    """How many levels, from the coarsest on, random training pixels need; all if none is seen."""

    def count(ray_count):
        batch = next(looks(bank, field.device, ray_count, ray_count))
        field.march(batch)
        whole, needed = _shown(field, batch), field.options.level_count
        while needed > 1:
            with _coarsest(field, needed - 1):
                if not _shows(whole, _shown(field, batch)):
                    break
            needed -= 1
        return needed

    given = LOOK_RAYS, SMALLEST_LOOK, "rays at once", field.workers, field.device
    return within_memory(count, *given)


def _shown(field: TrainingField, batch: Batch) -> tuple[torch.Tensor, torch.Tensor]:
    """Colors on white [R, 3] and opacity [R] of marched rays."""
    color, opacity, *_ = field.composite(batch)
    return color + (1.0 - opacity[:, None]), opacity


def _shows(whole, other) -> bool:
    """Whether the object's pixels are the same to rounding; false if there are none."""
    seen = torch.maximum(whole[1], other[1]) > SEEN
    squares = (whole[0] - other[0])[seen].square()
    return bool(seen.any()) and float(squares.mean()) <= ROUNDING**2


@contextmanager
def _coarsest(field: TrainingField, count: int) -> Iterator[None]:
    """Context in which the networks see the coarsest levels alone."""
    weight = field.networks.density[0].weight
    whole = weight.detach().clone()
    weight[:, count * FEATURES :] = 0.0
    try:
        yield
    finally:
        weight.copy_(whole)
