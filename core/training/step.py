"""One optimiser step: draw rays, render them, compare, go back, update.

On CUDA a step has a fixed number of rays and a fixed room for samples, nothing in it waits
for the host, and it is recorded once as a CUDA graph; learning rate, background and jitter
seed are values on the device.  On the CPU the same step runs as it is, with exactly as
many samples as there are.
"""

import torch
import warp as wp

from .batch import Batch
from .raybank import RayBank
from .stage import Stage
from .surroundings import over

BETAS, EPSILON = (0.9, 0.999), 1e-15  # the paper's Adam
LOSS_SCALE = 1024.0  # keeps fp16 gradients from vanishing; Adam doesn't see it
SEED_STRIDE = 15_485_863  # a prime: runs of a million steps stay apart
WARM_UP_SEED = 1 << 28  # the runs before a recording see rays of their own
WARM_UP_RUNS = 3  # before a graph is recorded: libraries choose their kernels there


class Step:
    """A training step of `ray_count` rays; `run` it again and again.

    Attributes:
        number: Steps done.
        error: Mean squared error of the last step.  torch [] on the device
        batch: The last step's samples.
    """

    def __init__(
        self, stage: Stage, bank: RayBank, distortion: float, samples_per_step: int, seed=0
    ):
        self.stage, self.bank, self.distortion = stage, bank, distortion
        self.samples_per_step = samples_per_step
        device = stage.torch_device
        self._white = torch.zeros(1, device=device)
        self._rate = torch.zeros((), device=device)
        # Draws and jitter follow the step's number, and are apart for each `seed`.
        self._first_seed = (seed * SEED_STRIDE) % 2**30
        self._seed = torch.zeros(1, dtype=torch.int32, device=device)
        self.error = torch.zeros((), device=device)
        self.optimizer = torch.optim.Adam(
            stage.parameters(),
            lr=self._rate if device.type == "cuda" else 0.0,
            betas=BETAS,
            eps=EPSILON,
            fused=True,
            capturable=device.type == "cuda",
        )
        self.number = 0
        self.batch = None
        self._graph = None

    def set_ray_count(self, ray_count: int):
        """Make room for that many rays; on CUDA the next run records a new graph."""
        on_cuda = self.stage.device.is_cuda
        self._graph = None
        self.batch = Batch(ray_count, self.samples_per_step if on_cuda else None, self.stage.device)

    def run(self, rate: float, white: bool):
        """One step with that learning rate, on white or on random backgrounds."""
        self._white.fill_(float(white))
        self._seed.fill_(self._first_seed + self.number + 1)  # never 0: that means no jitter
        if not self.stage.device.is_cuda:
            for group in self.optimizer.param_groups:
                group["lr"] = rate
            self._work()
        else:
            self._rate.fill_(rate)
            if self._graph is None:
                self._record()
            self._graph.replay()
        self.number += 1

    def state(self) -> dict:
        """What a later run needs to go on: optimiser, randomness, number of rays."""
        return {
            "optimizer": self.optimizer.state_dict()["state"],
            "number": self.number,
            "ray_count": self.batch.ray_count,
            "samples_per_step": self.samples_per_step,
        }

    def load_state(self, state: dict):
        """Go on from `state`; the stage's own has to be loaded too."""
        whole = self.optimizer.state_dict()
        rates = [group["lr"] for group in self.optimizer.param_groups]
        self.optimizer.load_state_dict({**whole, "state": state["optimizer"]})
        for group, rate in zip(self.optimizer.param_groups, rates, strict=True):
            group["lr"] = rate  # the very tensor that a graph reads
        self.number = state["number"]
        self.samples_per_step = state["samples_per_step"]
        self.set_ray_count(state["ray_count"])

    def sample_count(self) -> int:
        """Samples that the last step's rays had, those left out included; waits for the device."""
        ends = self.batch.ends
        return int(ends[len(ends) - 1 :].numpy()[0])

    def _work(self):
        stage, batch = self.stage, self.batch
        wp.to_torch(batch.seed).copy_(self._seed)
        self.bank.draw(batch.seed, batch.drawn)
        rgba = batch.rgba
        alpha = rgba[:, 3:]
        color, opacity, distortion, _ = stage.trace(batch)
        if stage.surroundings:
            target = rgba[:, :3]
            with stage.precision():
                front, behind = stage.surroundings(
                    batch.drawn.origins, batch.drawn.directions, batch.seed
                )
            color = over(front, color, opacity, behind)
        else:
            background = torch.maximum(batch.background, self._white)
            target = rgba[:, :3] * alpha + background * (1.0 - alpha)
            color = color + (1.0 - opacity[:, None]) * background
        fits = batch.fits / batch.fits.sum().clamp(min=1.0)
        error = (fits[:, None] * (color - target) ** 2).sum() / 3.0
        loss = error + self.distortion * (fits * distortion).sum()
        self.optimizer.zero_grad(set_to_none=True)
        (loss * LOSS_SCALE).backward()
        self.optimizer.step()
        self.error.copy_(error.detach())

    def _record(self):
        """Record the step; the runs before the recording are steps too."""
        device = self.stage.device
        stream = wp.get_stream(device)
        for _ in range(WARM_UP_RUNS):
            self._seed.add_(WARM_UP_SEED)
            self._work()
        self._seed.sub_(WARM_UP_RUNS * WARM_UP_SEED)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(
            graph, stream=wp.stream_to_torch(stream), capture_error_mode="thread_local"
        ):
            wp.capture_begin(device, stream=stream, external=True)
            try:
                self._work()
            finally:
                wp.capture_end(device, stream=stream)
        self._graph = graph
