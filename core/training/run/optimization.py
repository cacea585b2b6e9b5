"""The optimization of a field: Adam steps on random rays, as many as a stage of training has.

A step draws rays, marches them, composites their samples, compares the colors with the
photographs' and updates the weights.  On the CPU its arrays have exactly one place for each sample;
on CUDA the steps are recorded (recorded_steps.py).  Several workers each take a share of the rays
and of the places for samples, and exchange gradients (exchange.py).

Every few steps the run updates the occupancy, adapts the number of rays to the places for samples,
and examines the loss (monitoring.py).  If memory is too small, it halves the number of places.
"""

from collections.abc import Callable
from contextlib import contextmanager

import numpy as np
import torch
import warp as wp

from ..data.raybank import RayBank
from ..train_options import TrainOptions
from . import recorded_steps
from .adam import Adam, learning_rate, rate_groups
from .batch import Batch
from .checkpoint_checks import checked_scale
from .loss import add_table_decay, training_loss
from .memory import ALLOCATION_ERRORS, give_memory_back, halved, memory_name
from .monitoring import Diverged, LossWatch, TrainingProgress
from .peer_exchange import make_exchange
from .recorded_steps import RecordedSteps
from .sample_limits import SampleLimits
from .training_field import TrainingField

# Adam cancels it.  Less, and float16 loses the gradients that hold the color network's sums.
LOSS_SCALE = 2.0**17
FIRST_LOSS_SCALE = 2.0**10  # of checkpoints that tell none, and have no limits
WHITE_SHARE = 0.5  # of the steps, at the end, on a white background
PAUSE_INTERVAL = 16  # steps from one look at loss, occupancy and ray count to the next
OCCUPANCY_WARM_UP = 256  # steps in which every update looks at all sub-tets
OCCUPANCY_TURNS = 4  # later it looks at every fourth
AVERAGED_SHARE = 0.2  # of the steps so far, over which the weights that are kept are averaged
RAYS_AT_START, FEWEST_RAYS, MOST_RAYS = 1 << 10, 1 << 8, 1 << 16
SURROUNDED_RAYS = 1 << 14  # at most, where each takes 64 samples of surroundings besides
RAY_SPACE = 1.5  # times the rays of a step that graphs are recorded for, so that more fit later
LEAST_USED = 0.25  # of that; with fewer rays new graphs are recorded
FILLED = 0.9  # share of a step's space for samples that the number of rays aims at
SMALLEST_SPACE = 1 << 13  # samples a step; with fewer, training would take hours
SEED_STRIDE = 15_485_863  # a prime: runs of a million steps stay apart
RECORDING_SEED = 1 << 28  # the runs before a recording see rays of their own
RECORDING_RUNS = 3  # before a graph is recorded: libraries choose their kernels there


class Optimization:
    """The steps of one stage; `run` does those that are left.

    Attributes:
        number: Steps done.
        error: Mean squared error of the last step.  torch [] on the device
        ray_count: Rays of a step, of all workers together.
        samples_per_step: Space for their samples, of all workers together.

    Args:
        has_alpha: Whether the images have alpha, and so a background of the step's choice.
        step_count: Steps of the whole stage.
        final_rate: Learning rate at its end, as a share of the highest.
        depth_cost: Weight of the cost of depth in the first step, see definition/loss.py.
        depth_steps: In so many steps it falls to 0.
        strong_decay: Whether features decay by the option of that name.
    """

    def __init__(
        self,
        field: TrainingField,
        bank: RayBank,
        options: TrainOptions,
        has_alpha: bool,
        step_count: int,
        final_rate: float,
        depth_cost: float = 0.0,
        depth_steps: int = 1,
        strong_decay: bool = False,
    ):
        self.field, self.bank, self.options = field, bank, options
        self.has_alpha, self.step_count, self.final_rate = has_alpha, step_count, final_rate
        self.workers = field.workers
        self.distortion = 0.0 if "distortion" in options.leave_out else options.distortion
        self.samples_per_step = options.samples_per_step
        self.number = 0
        # Draws and jitter follow from the step's number and the seed.
        self._first_seed = (options.seed * SEED_STRIDE) % 2**30
        device = field.torch_device
        self._white = torch.zeros(1, device=device)
        self.depth_cost, self.depth_steps = depth_cost, depth_steps
        self.strong_decay = strong_decay
        self._depth_weight = torch.zeros(1, device=device) if depth_cost else None
        self.error = torch.zeros((), device=device)
        several = self.workers.count > 1
        self._exchange = make_exchange(field, self.error) if several else None
        groups = rate_groups(field, self._exchange.parameters if several else field.parameters())
        for group in groups:  # on CUDA a graph reads the rates
            group["lr"] = torch.zeros((), device=device) if device.type == "cuda" else 0.0
        self.optimizer = Adam(groups)
        self._make_whole = self._exchange.make_whole if several else lambda: None
        self._watch = LossWatch(field, self._make_whole)
        # Surroundings learn from rays that meet no matter.
        skips_empty = not field.surroundings
        self._limits = SampleLimits(bank.pixel_count, skips_empty, field.device)
        self._average = None  # of what this worker updates, exponentially weighted
        self._batches, self._recorded, self._has_recorded = [], None, False
        self.set_ray_count(RAYS_AT_START)

    def run(
        self,
        progress: TrainingProgress,
        title: str,
        after_pause: Callable[[], None] = lambda: None,
        note: Callable[[int, float], None] = lambda step, mse: None,
        until: int | None = None,
    ):
        """Do all steps that are left, then give the field its averaged weights.

        Args:
            after_pause: Called every few steps.
            note: The same, with the number of steps and the last one's error, finite or not.
            until: Stop after that many steps of the stage, a multiple of PAUSE_INTERVAL, because
                weights are averaged there; the field keeps its weights.

        Raises:
            Diverged: See there.
            OutOfMemory: Even a small batch doesn't fit into the memory.
            KeyboardInterrupt: One of several workers was interrupted; all raise it.
        """
        self._watch.keep_good(self.number)
        end = self.step_count if until is None else until
        task = progress.begin(title, end, self.number)
        self._shown = self.number
        while self.number < end:
            if self.number % PAUSE_INTERVAL == 0 and self.number > self._shown:
                # Launched before the look at the loss, which waits for the device.
                if self._recorded:
                    self._recorded.wait_until_prepared()  # marches have copied the occupancy
                self.field.update_occupancy(
                    1 if self.number < OCCUPANCY_WARM_UP else OCCUPANCY_TURNS
                )
                self._average_weights()
                self._adapt_ray_count(self._examine(progress, task, note))
                after_pause()
                self.workers.stop_if_interrupted()
            highest = self.options.learning_rate * self._watch.rate_share(self.number)
            rate = learning_rate(self.number, self.step_count, highest, self.final_rate)
            white = not self.has_alpha or self.number >= (1.0 - WHITE_SHARE) * self.step_count
            try:
                self.step(rate, white)
            except ALLOCATION_ERRORS as error:
                self._halve_space(progress, error)
        if self._recorded:
            self._recorded.wait()  # the batches may be freed after this, and marches write to them
        self._examine(progress, task, note)
        self._average_weights()
        if end == self.step_count:
            self.field.set_weights(self._whole_average())

    def step(self, rate: float, white: bool):
        """Do one step with that learning rate, on white or on random backgrounds."""
        self._white.fill_(float(white))
        if self._depth_weight is not None:
            left = 1.0 - self.number / self.depth_steps
            self._depth_weight.fill_(self.depth_cost * max(left, 0.0))
        for group in self.optimizer.param_groups:
            if self.field.device.is_cuda:
                group["lr"].fill_(group["share"] * rate)
            else:
                group["lr"] = group["share"] * rate
        if self.field.device.is_cuda:
            if self._recorded is None:
                self._record()
            self._recorded.run(self.number, self._prepare)
        else:
            self._draw_and_learn(self._batches[0], self.number)
        self.number += 1

    @property
    def table_decay(self) -> float:
        """Weight of the table's decay."""
        options = self.options
        if "table-decay" in options.leave_out:
            return 0.0
        decay = options.strong_decay if self.strong_decay else options.table_decay
        return decay / self.bank.drawn_pixel_count

    def go_on(self):
        """Make the batches anew that were freed; a cost of depth is over."""
        self._depth_weight = None
        self.set_ray_count(self.ray_count)

    @property
    def returns(self) -> int:
        """How often the stage went back to its last good weights."""
        return self._watch.returns

    @property
    def batch(self) -> Batch:
        """The last step's samples; before the first, the next step's."""
        return self._batches[max(self.number - 1, 0) % len(self._batches)]

    def sample_count(self) -> int:
        """Samples of the last step's rays, those left out too; waits for device and workers."""
        return self.workers.total(int(wp.to_torch(self.batch.ends)[-1]))

    def set_ray_count(self, ray_count: int, capacity: int | None = None):
        """Take that many rays a step; on CUDA the next one records graphs for `capacity`."""
        device = self.field.device
        self.free_batches()
        samples, copies = None, 1  # the CPU makes space for what each march finds
        if device.is_cuda:
            samples = -(-self.samples_per_step // self.workers.count)
            copies = recorded_steps.AHEAD + 1
        self._ray_capacity = capacity or ray_count
        rays = self.workers.share(self._ray_capacity)
        size = len(rays), samples, device, rays.start, not self.field.options.deferred
        self._batches = [Batch(*size) for _ in range(copies)]
        if device.is_cuda:
            for batch in self._batches:
                batch.mask = wp.clone(self.field.mask)
        self.ray_count = ray_count

    def free_batches(self):
        """Free the memory of batches and graphs."""
        if self._recorded:
            torch.cuda.synchronize(self.field.torch_device)
        self._batches, self._recorded = [], None

    def _prepare(self, batch, number):
        """Rays, occupancy and randomness (never 0, which means no jitter) for step `number`."""
        batch.use(min(len(self.workers.share(self.ray_count)), batch.ray_count))
        wp.to_torch(batch.seed).fill_(self._first_seed + number + 1)
        if batch.mask is not None:
            wp.to_torch(batch.mask).copy_(wp.to_torch(self.field.mask))

    def _march(self, batch):
        # On CUDA a step may change limits while batches ahead read them: both values are valid.
        self.bank.draw(batch.seed, batch.drawn, limits=self._limits.of_pixels)
        self.field.march(batch)

    def _backpropagate(self, batch):
        """Gradients and error, of this worker's rays."""
        loss, error = training_loss(
            self.field, batch, self._white, self.distortion, self._limits, self._depth_weight
        )
        parameters = self.field.parameters()
        gradients = torch.autograd.grad(loss * LOSS_SCALE, parameters)
        if self.table_decay:
            add_table_decay(gradients[0], self.field, self.table_decay * LOSS_SCALE)
        self.error.copy_(error.detach())
        if self._exchange:
            self._exchange.collect(gradients, batch.pixels_tried())
            self._limits.keep(batch)
            return
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient

    def _learn(self, batch):
        """Gradients and update of a single worker."""
        self.optimizer.zero_grad()  # before more memory is taken
        self._backpropagate(batch)
        self.optimizer.step()
        self._limits.keep(batch)

    def _tasks(self):
        """The tasks of learning from a batch: name -> (function, whether a graph holds it)."""
        if self._exchange is None:
            return {"learn": (self._learn, True)}
        tasks = {"learn": (self._backpropagate, True)}
        for name, (function, records) in self._exchange.tasks(self.optimizer).items():
            tasks[name] = (lambda _batch, function=function: function(), records)
        return tasks

    def _draw_and_learn(self, batch, number):
        self._prepare(batch, number)
        self._march(batch)
        for task, _ in self._tasks().values():
            task(batch)

    def _record(self):
        """Record the step; the runs before the first recording update weights, too."""
        if not self._has_recorded:
            for run in range(RECORDING_RUNS):
                batch = self._batches[run % len(self._batches)]
                self._draw_and_learn(batch, RECORDING_SEED + run)
            self._has_recorded = True
        self._recorded = RecordedSteps(self.field.device, self._batches, self._march, self._tasks())

    def _examine(self, progress, task, note) -> int:
        """Show, note and judge the last step's error; return the number of its samples."""
        error, sample_count = float(self.error), self.sample_count()
        progress.advance(task, self.number - self._shown, error, sample_count)
        note(self.number, error)
        self._shown = self.number
        try:
            returned = self._watch.examine(error, self.number, self.step_count)
        except Diverged:
            self._average = None  # it may hold what was lost
            raise
        if returned:
            self._average = None
            self.optimizer.forget()
            self._limits.forget()
            self.set_ray_count(RAYS_AT_START)  # without limits rays have more samples
            progress.say(returned)
        return sample_count

    def _adapt_ray_count(self, sample_count):
        ray_count = next_ray_count(self.ray_count, sample_count, self.samples_per_step)
        if self.field.surroundings:
            ray_count = min(ray_count, SURROUNDED_RAYS)
        if ray_count == self.ray_count:
            return
        # Surroundings are evaluated for rays that are not in use as well.
        if self._recorded is None or self.field.surroundings:
            self.set_ray_count(ray_count)
        elif LEAST_USED * self._ray_capacity <= ray_count <= self._ray_capacity:
            self.ray_count = ray_count  # of the batches that are marched from now on
        else:
            self.set_ray_count(ray_count, int(RAY_SPACE * ray_count))

    @torch.no_grad()
    def _average_weights(self):
        parameters = self._exchange.parameters if self._exchange else self.field.parameters()
        if self._average is None:
            self._average = [p.clone() for p in parameters]
        span = AVERAGED_SHARE * (self.number - self._watch.returned_at) / PAUSE_INTERVAL
        torch._foreach_lerp_(self._average, parameters, 1.0 / max(span, 1.0))

    def _whole_average(self):
        """The averages of the field's parameters, or None; waits for all workers."""
        if self._average is None or self._exchange is None:
            return self._average
        share, *others = self._average
        return [self._exchange.whole(share), *others]

    @contextmanager
    def averaged(self):
        """Context in which the field has its averaged weights; all workers have to enter it."""
        self._make_whole()
        raw = [p.detach().clone() for p in self.field.parameters()]
        self.field.set_weights(self._whole_average())
        try:
            yield
        finally:
            self.field.set_weights(raw)

    def _halve_space(self, progress, error):
        """Go on with half the samples a step, if `error` is a lack of memory."""
        count = halved(error, self.samples_per_step, SMALLEST_SPACE, "samples a step", self.workers)
        self.samples_per_step = count
        ray_count = max(FEWEST_RAYS, self.ray_count // 2)
        self.free_batches()
        give_memory_back(self.field.device)
        self.set_ray_count(ray_count)
        name = memory_name(error)
        progress.say(f"The {name} is too small; going on with {count} samples a step.")

    def state(self) -> dict:
        """The state to resume from with any number of workers; waits for all of them."""
        self._make_whole()
        state = self.optimizer.numbered_state()
        if self._exchange and state:
            state = {**state, 0: self._map_moments(state[0], self._exchange.whole)}
        return {
            "step": {
                "optimizer": state,
                "loss_scale": LOSS_SCALE,
                "number": self.number,
                "ray_count": self.ray_count,
                "samples_per_step": self.samples_per_step,
                "returns": (self._watch.returns, self._watch.returned_at),
            },
            "stage": self.field.state(),
            "average": self._whole_average(),
            "limits": wp.to_torch(self._limits.of_pixels),  # of several workers the first one's
        }

    @staticmethod
    def _map_moments(state, function):
        """Adam's state of the table, with the function applied to what has its rows."""
        return {
            name: function(value) if name.startswith("exp_avg") else value
            for name, value in state.items()
        }

    def load_state(self, state: dict):
        """Go on from `state`, whose field has the mesh and the options of this one."""
        self.field.load_state(state["stage"])
        step = state["step"]
        moments = step["optimizer"]
        if self._exchange and moments:
            moments = {**moments, 0: self._map_moments(moments[0], self._exchange.share)}
        limits = state.get("limits")
        scale = step.get("loss_scale", FIRST_LOSS_SCALE if limits is None else LOSS_SCALE)
        self.optimizer.load(moments, LOSS_SCALE / checked_scale(scale))
        self.number = step["number"]
        self._watch.load(*step.get("returns", (0, 0)), self.number)
        self.samples_per_step = step["samples_per_step"]
        self.set_ray_count(step["ray_count"])
        self._limits.load(limits)
        if state["average"] is not None:
            device = self.field.torch_device
            self._average = [weights.to(device) for weights in state["average"]]
            if self._exchange:
                self._average[0] = self._exchange.share(self._average[0])


def next_ray_count(ray_count, sample_count, capacity):
    """The number of rays whose samples fill the capacity without overflowing it.

    It stays while the capacity is 80 to 100 % full: CUDA graphs may have to be recorded again.
    """
    filled = sample_count / capacity
    if 0.8 <= filled <= 1.0:
        return ray_count
    wanted = ray_count * np.clip(FILLED / max(filled, 1e-6), 0.25, 4.0)
    return int(np.clip(wanted, FEWEST_RAYS, MOST_RAYS))
