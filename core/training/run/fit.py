"""The optimisation of one stage, step after step, and what can go wrong in it.

Every few steps the occupancy is renewed, the number of rays adapted to the room for samples,
and the loss looked at: one that is no number, or far above what it was, ends the run with
the last good weights.  Where the GPU's memory is too small, the room is halved, aloud; of
several workers that ends the run.
"""

from collections.abc import Callable
from contextlib import contextmanager
from math import cos, isfinite, pi

import numpy as np
import torch

from ..data import RayBank
from ..options import TrainOptions
from .progress import TrainingProgress
from .stage import Stage
from .step import Step

WARM_UP_STEPS = 100
FINAL_RATE = 0.1  # of the first learning rate, at the cosine's end
WHITE_SHARE = 0.5  # of the steps, at the end
OCCUPANCY_INTERVAL = 16  # steps
OCCUPANCY_WARM_UP = 256  # steps in which every update looks at all sub-tets
RAYS_AT_START, FEWEST_RAYS, MOST_RAYS = 1 << 10, 1 << 8, 1 << 16
FILLED = 0.9  # share of a step's room for samples that the number of rays aims at
SMALLEST_ROOM = 1 << 13  # samples; with less, training takes for ever
SNAPSHOT_INTERVAL = 512  # steps
DIVERGED_FACTOR = 20.0  # of the smoothed loss over the lowest so far
OCCUPANCY_PARTS = 4  # later it looks at every fourth
SMOOTHING = 0.8  # of the loss, per OCCUPANCY_INTERVAL
AVERAGED_SHARE = 0.02  # of the steps, over which the weights that are kept are averaged


class Diverged(Exception):
    """The loss is lost; the message is one sentence, the stage has its last good weights."""


class Fit:
    """A stage's way through its steps.

    Attributes:
        step: The optimiser step; it counts.
    """

    def __init__(self, stage: Stage, bank: RayBank, options: TrainOptions, has_alpha, step_count):
        self.stage, self.options = stage, options
        self.has_alpha, self.step_count = has_alpha, step_count
        distortion = 0.0 if "distortion" in options.leave_out else options.distortion
        self.step = Step(stage, bank, distortion, options.samples_per_step, options.seed)
        self.step.set_ray_count(RAYS_AT_START)
        self._smooth = self._lowest = None
        self._good, self._good_number = None, 0
        self._average = None  # of the parameters, exponentially weighted

    @property
    def number(self) -> int:
        """Steps done."""
        return self.step.number

    def run(
        self,
        progress: TrainingProgress,
        title: str,
        after_pause: Callable[[], None] = lambda: None,
        note: Callable[[int, float], None] = lambda step, mse: None,
    ):
        """All the steps that are left.

        Args:
            after_pause: Called every few of them.
            note: Called with the number of steps and the last one's error, whenever it is
                looked at, even if it is lost.

        Raises:
            Diverged: See there.
        """
        self._keep_good()
        task = progress.begin(title, self.step_count, self.number)
        shown = self.number
        while self.number < self.step_count:
            if self.number % OCCUPANCY_INTERVAL == 0 and self.number > shown:
                error, sample_count = float(self.step.error), self.step.sample_count()
                progress.advance(task, self.number - shown, error, sample_count)
                note(self.number, error)
                shown = self.number
                self._watch(error)
                self.stage.update_occupancy(
                    1 if self.number < OCCUPANCY_WARM_UP else OCCUPANCY_PARTS
                )
                self._adapt(sample_count)
                self._average_weights()
                after_pause()
                self.stage.workers.stop_if_interrupted()
            try:
                self._run_step()
            except RuntimeError as error:
                if not lacks_memory(error):
                    raise
                self._halve_room(progress, error)
                continue
        error = float(self.step.error)
        progress.advance(task, self.number - shown, error, self.step.sample_count())
        note(self.number, error)
        self._watch(error)
        self._average_weights()
        self._set_weights(self._average)

    def state(self) -> dict:
        return {
            "step": self.step.state(),
            "stage": self.stage.state(),
            "average": self._average,
        }

    def load_state(self, state: dict):
        self.stage.load_state(state["stage"])
        self.step.load_state(state["step"])
        if state["average"] is not None:
            device = self.stage.torch_device
            self._average = [weights.to(device) for weights in state["average"]]

    @contextmanager
    def averaged(self):
        """Context in which the stage has its averaged weights, as at the end of a run."""
        raw = [p.detach().clone() for p in self.stage.parameters()]
        self._set_weights(self._average)
        try:
            yield
        finally:
            self._set_weights(raw)

    def _run_step(self):
        white = not self.has_alpha or self.number >= (1.0 - WHITE_SHARE) * self.step_count
        rate = learning_rate(self.number, self.step_count, self.options.learning_rate)
        self.step.run(rate, white)

    def _adapt(self, sample_count):
        room = self.step.samples_per_step
        ray_count = next_ray_count(self.step.ray_count, sample_count, room)
        if ray_count != self.step.ray_count:
            self.step.set_ray_count(ray_count)

    def _watch(self, error):
        """Keep good weights from time to time; go back to them when the loss is lost."""
        if not isfinite(error):
            self._give_up(f"the loss became {error}")
        if self._smooth is None:
            self._smooth = self._lowest = error
        self._smooth = SMOOTHING * self._smooth + (1.0 - SMOOTHING) * error
        self._lowest = min(self._lowest, self._smooth)
        if self._smooth > DIVERGED_FACTOR * self._lowest:
            self._give_up(f"the loss rose from {self._lowest:.2g} to {self._smooth:.2g}")
        # Early on, when much is learnt in few steps, more often.
        if self.number - self._good_number >= min(SNAPSHOT_INTERVAL, max(self._good_number, 1)):
            self._keep_good()

    def _keep_good(self):
        parameters = [p.detach() for p in self.stage.parameters()]
        if not all(bool(p.isfinite().all()) for p in parameters):
            self._give_up("a weight became infinite")
        self._good, self._good_number = [p.clone() for p in parameters], self.number

    @torch.no_grad()
    def _average_weights(self):
        parameters = list(self.stage.parameters())
        if self._average is None:
            self._average = [p.clone() for p in parameters]
        span = AVERAGED_SHARE * self.step_count / OCCUPANCY_INTERVAL
        torch._foreach_lerp_(self._average, parameters, 1.0 / max(span, 1.0))

    @torch.no_grad()
    def _set_weights(self, weights):
        """Make them the stage's parameters, if there are any."""
        for mine, given in zip(self.stage.parameters(), weights or (), strict=weights is not None):
            mine.copy_(given)

    def _give_up(self, what):
        self._set_weights(self._good)
        self._average = None  # it may hold what was lost
        raise Diverged(
            f"{what} at step {self.number} of {self.step_count}; kept are the weights of step "
            f"{self._good_number}"
        )

    def _halve_room(self, progress, error):
        workers = self.stage.workers
        if workers.count > 1:  # the others are in the middle of a step that has no end
            raise MemoryError(
                f"the GPU of worker {workers.rank} has too little memory for its share of "
                f"{self.step.samples_per_step} samples a step: take more GPUs, shrink the images "
                f"with --image-size, or take --preset tiny ({error})"
            ) from error
        room = self.step.samples_per_step // 2
        if room < SMALLEST_ROOM:
            raise MemoryError(
                f"the GPU's memory is too small for {2 * room} samples a step: shrink the images "
                f"with --image-size, or take --preset tiny ({error})"
            ) from error
        self.step.samples_per_step = room
        ray_count = max(FEWEST_RAYS, self.step.ray_count // 2)
        self.step.forget_batches()
        if self.stage.device.is_cuda:
            torch.cuda.empty_cache()
        self.step.set_ray_count(ray_count)
        progress.say(f"The GPU's memory is too small; going on with {room} samples a step.")


def lacks_memory(error: RuntimeError) -> bool:
    """Whether torch or Warp could not allocate."""
    return isinstance(error, torch.OutOfMemoryError) or "Failed to allocate" in str(error)


def learning_rate(step: int, step_count: int, highest: float) -> float:
    """Linear warm-up, then a cosine down to FINAL_RATE."""
    warm_up = min(1.0, (step + 1) / WARM_UP_STEPS)
    fall = 0.5 * (1.0 + cos(pi * step / step_count))
    return highest * warm_up * (FINAL_RATE + (1.0 - FINAL_RATE) * fall)


def next_ray_count(ray_count, sample_count, room):
    """As many rays as fill the room for samples without overflowing it.

    It stays as it is while that is nearly so: a new number costs a new CUDA graph.
    """
    filled = sample_count / room
    if 0.8 <= filled <= 1.0:
        return ray_count
    wanted = ray_count * np.clip(FILLED / max(filled, 1e-6), 0.25, 4.0)
    return int(np.clip(wanted, FEWEST_RAYS, MOST_RAYS))
