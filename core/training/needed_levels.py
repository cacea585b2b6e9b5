"""How many levels a trained model needs; the finest ones may change no image.

Decay pulls features to 0 that photographs don't teach.  Strong decay can do so with whole levels.
Such a level still takes megabytes of the model's file and time in each frame, so training leaves
it out at the end.

The test: draw random training pixels with all levels, then without the finest one, then without
the finest two, and so on.  A level is needed if leaving it and all finer ones out changes the
pixels of the object, in root mean square, by more than rounding to bytes does.
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
SEEN = 1.0 / 255.0  # a pixel of the object has a larger opacity


@torch.no_grad()
def needed_levels(field: TrainingField, bank: RayBank) -> int:
    """How many of the coarsest levels random training pixels need; all if none shows the object."""

    def count(ray_count):
        batch = next(looks(bank, field.device, ray_count, ray_count))
        field.march(batch)
        whole, needed = _shown(field, batch), field.options.level_count
        while needed > 1:
            with _coarsest(field, needed - 1):
                if not _equal(whole, _shown(field, batch)):
                    break
            needed -= 1
        return needed

    given = LOOK_RAYS, SMALLEST_LOOK, "rays at once", field.workers, field.device
    return within_memory(count, *given)


def _shown(field: TrainingField, batch: Batch) -> tuple[torch.Tensor, torch.Tensor]:
    """Colors on white [R, 3] and opacity [R] of marched rays."""
    color, opacity, *_ = field.composite(batch)
    return color + (1.0 - opacity[:, None]), opacity


def _equal(whole, other) -> bool:
    """Whether the object's pixels are equal up to rounding; false if there are none."""
    seen = torch.maximum(whole[1], other[1]) > SEEN
    squares = (whole[0] - other[0])[seen].square()
    return bool(seen.any()) and float(squares.mean()) <= ROUNDING**2


@contextmanager
def _coarsest(field: TrainingField, count: int) -> Iterator[None]:
    """Context in which the density network ignores all but the coarsest levels."""
    weight = field.networks.density[0].weight
    whole = weight.detach().clone()
    weight[:, count * FEATURES :] = 0.0
    try:
        yield
    finally:
        weight.copy_(whole)
