"""Which beginning of stage 2 goes on: several are tried, and validation views tell.

Two choices depend on the scene, and no rule is known that would tell beforehand:

- A cost of depth.  Where an object has a screen of wires round empty space, stage 2 may leave a fog
  there: if a fog has one color throughout, no pixel changes when its front goes away.  A cost of
  how far matter lies before its ray's last sample (the lead, definition/loss.py) takes the front
  away.  Other scenes lose by it; likely, what shines is learned too deep.
- Strong decay of features.  What is thin as a pixel, and mirrors, is learned with noise, which
  strong decay takes away.  Other scenes lose fine texture by it.

So the run begins stage 2 with neither, and learns from seven of eight views.  Then it begins anew
with the first choice, from the same seed, and the other views tell which beginning shows them
better.  The second choice is tried likewise, on top of the better one.  The best goes on, with all
views.  The cost of depth has fallen to 0 by then; decay stays.

A ray that SampleLimits cuts off has its last sample behind its surface, and so a small lead.
"""

from dataclasses import dataclass

import numpy as np
import torch
import warp as wp

from .data.datasets import Dataset
from .data.scene_box import are_photographs
from .run.batch import Batch
from .run.loss import training_loss
from .run.memory import within_memory
from .run.monitoring import psnr_of
from .run.optimization import Optimization
from .run.training_field import LOOK_RAYS, SMALLEST_LOOK

# About 3,000, a multiple of PAUSE_INTERVAL; after fewer, a cost of depth can't be judged.
TRIAL_STEPS = 2992
DEPTH_STEPS = 1800  # of these, in which the cost falls to 0
FEWEST_STEPS = 15_000  # of stage 2
FEWEST_VIEWS = 16
HELD_INTERVAL = 8  # every so many views one is held aside
MOST_PIXELS = 1 << 21  # that are compared


@dataclass(frozen=True)
class Choice:
    """What stage 2 is begun with, and may go on with.

    Attributes:
        name: In sentences.
        key: Of its gain on validation views, in the run's report.  [dB]
        leave_out: Words of LEAVE_OUT; with any of them it isn't tried.
    """

    name: str
    key: str
    leave_out: frozenset[str]

    def is_taken(self, report: dict) -> bool:
        return report.get(self.key, 0.0) > 0.0


DEPTH_COST = Choice("a cost of depth", "depth_gain", frozenset({"depth-cost"}))
STRONG_DECAY = Choice("strong decay", "decay_gain", frozenset({"strong-decay", "table-decay"}))


def choices_due(optimization: Optimization, dataset: Dataset, report: dict) -> list[Choice]:
    """What stage 2, begun or resumed, is to be tried with, in this order.

    Photographs of an object in its surroundings have no trial: what is learned beside the field
    would be learned twice.  Neither have several workers, short runs and few views.
    """
    options = optimization.options
    if (
        optimization.step_count < FEWEST_STEPS
        or optimization.number > TRIAL_STEPS
        or optimization.workers.count > 1
        or dataset.view_count < FEWEST_VIEWS
        or are_photographs(dataset, options)
    ):
        return []
    weights = {DEPTH_COST: options.depth_cost, STRONG_DECAY: options.strong_decay}
    return [
        choice
        for choice, weight in weights.items()
        if weight > 0.0
        and choice.key not in report
        and choice.leave_out.isdisjoint(options.leave_out)
    ]


def validation_views(view_count: int) -> range:
    """The views that no beginning learns from."""
    return range(HELD_INTERVAL // 2, view_count, HELD_INTERVAL)


@torch.no_grad()
def validation_psnr(optimization: Optimization, pixels) -> float:
    """PSNR of these pixels on white, or of MOST_PIXELS of them, by the averaged weights.  [dB]"""
    field, bank = optimization.field, optimization.bank
    if len(pixels) > MOST_PIXELS:  # the same ones each time
        pixels = np.sort(np.random.default_rng(0).choice(pixels, MOST_PIXELS, replace=False))
    white = torch.ones(1, device=field.torch_device)

    def squares(ray_count):
        total = 0.0
        for some in np.split(pixels, range(ray_count, len(pixels), ray_count)):
            batch = Batch(len(some), None, field.device, harmonics=not field.options.deferred)
            bank.draw(batch.seed, batch.drawn, wp.array(some, dtype=int, device=field.device))
            field.march(batch)  # its seed is 0, so nothing is jittered
            total += len(some) * float(training_loss(field, batch, white, 0.0)[1])
        return total

    with optimization.averaged():
        given = LOOK_RAYS, SMALLEST_LOOK, "rays at once", field.workers, field.device
        return psnr_of(within_memory(squares, *given) / len(pixels))
