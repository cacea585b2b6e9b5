"""Whether stage 2 begins with a cost of depth: both are tried, and validation views tell.

Where an object has a screen of wires round empty space, stage 2 may leave a fog there: if a fog has
one color throughout, no pixel changes when its front goes away.  A cost of how far matter lies
before its ray's last sample (the lead, definition/loss.py) takes the front away.  Other scenes lose
by it; likely, what shines is learned too deep.  So the run begins stage 2 twice, from one seed,
without and with the cost, and learns from seven of eight views.  Then the other views tell which
beginning shows them better.  That one goes on, with all views.  The cost has fallen to 0 by then.

A ray that SampleLimits cuts off has its last sample behind its surface, and so a small lead.
"""

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

TRIAL_STEPS = 2992  # about 3,000, a multiple of PAUSE_INTERVAL; after fewer, views do not tell
DEPTH_STEPS = 1800  # of these, in which the cost falls to 0
FEWEST_STEPS = 15_000  # of stage 2
FEWEST_VIEWS = 16
HELD_INTERVAL = 8  # every so many views one is held aside
MOST_PIXELS = 1 << 21  # that are compared


def is_due(optimization: Optimization, dataset: Dataset) -> bool:
    """Whether stage 2, begun or resumed, is to be tried with a cost of depth.

    Photographs of an object in its surroundings have no trial: what is learned beside the field
    would be learned twice.  Neither have several workers, short runs and few views.
    """
    options = optimization.options
    return (
        options.depth_cost > 0.0
        and "depth-cost" not in options.leave_out
        and optimization.step_count >= FEWEST_STEPS
        and optimization.number <= TRIAL_STEPS
        and optimization.workers.count == 1
        and dataset.view_count >= FEWEST_VIEWS
        and not are_photographs(dataset, options)
    )


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
