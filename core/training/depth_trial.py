"""Whether stage 2 should begin with a cost of depth: both ways are tried.

Where an object has a screen of wires round empty space, stage 2 may leave a fog there: if a fog has
one color throughout, no pixel changes when its front goes away.  A cost of what comes before the
last sample of a ray (the lead, definition/loss.py) takes the front away.  Other scenes lose by it:
what shines is learned too deep.  So the run begins stage 2 twice, from one seed, without and with
the cost, and learns from seven of eight views.  After 3,000 steps the other views tell which
beginning shows them better.  That one goes on, with all views.  The cost has fallen to 0 by then.
"""

import numpy as np
import torch
import warp as wp

from .run.batch import Batch
from .run.loss import training_loss
from .run.monitoring import psnr_of
from .run.optimization import PAUSE_INTERVAL, Optimization

TRIAL_STEPS, TRIAL_SHARE = 3000, 0.2  # of stage 2, the fewer; earlier, views don't tell
COST_SHARE = 0.6  # of the trial's steps, in which the cost falls to 0
HELD_INTERVAL = 8  # every so many views one is held aside
FEWEST_VIEWS = 16
MOST_PIXELS, RAYS_AT_ONCE = 1 << 21, 1 << 14  # that are compared


def trial_end(optimization: Optimization, view_count: int) -> int:
    """The step at which two beginnings of stage 2 are compared; 0 if there is no trial.

    Captures have none: surroundings, exposures and what masks don't tell are learned beside the
    field, and a second beginning would learn them on.  Several workers have none.
    """
    field, options = optimization.field, optimization.options
    beside = field.surroundings, field.exposure, field.plates
    if (
        options.depth_cost == 0.0
        or "depth-cost" in options.leave_out
        or field.workers.count > 1
        or view_count < FEWEST_VIEWS
        or any(part is not None for part in beside)
    ):
        return 0
    end = min(TRIAL_STEPS, int(TRIAL_SHARE * optimization.step_count))
    end -= end % PAUSE_INTERVAL
    return end if optimization.number <= end else 0  # a resumed run may be beyond


def views_aside(view_count: int) -> range:
    """The views that no beginning learns from."""
    return range(HELD_INTERVAL // 2, view_count, HELD_INTERVAL)


@torch.no_grad()
def held_psnr(optimization: Optimization, pixels) -> float:
    """PSNR of these pixels on white, or of MOST_PIXELS of them, by the averaged weights.  [dB]"""
    field, bank = optimization.field, optimization.bank
    if len(pixels) > MOST_PIXELS:  # the same ones each time
        pixels = np.sort(np.random.default_rng(0).choice(pixels, MOST_PIXELS, replace=False))
    white, errors = torch.ones(1, device=field.torch_device), []
    with optimization.averaged():
        for some in np.split(pixels, range(RAYS_AT_ONCE, len(pixels), RAYS_AT_ONCE)):
            batch = Batch(len(some), None, field.device, harmonics=not field.options.deferred)
            bank.draw(batch.seed, batch.drawn, wp.array(some, dtype=int, device=field.device))
            field.march(batch)  # its seed is 0, so nothing is jittered
            errors.append(len(some) * training_loss(field, batch, white, 0.0)[1])
    return psnr_of(float(sum(errors)) / len(pixels))
