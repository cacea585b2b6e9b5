"""One optimiser step: draw rays, march them, render, compare, go back, update.

On CUDA a step has a fixed number of rays and a fixed room for samples and nothing in it waits
for the host.  It is recorded as two CUDA graphs, with learning rate, background and seed as
values on the device: one draws and marches a batch, one learns from it.  There are two
batches: while one is learnt from, the next is marched on a stream of its own, because a march
is a long chain of small loads that leaves the GPU nearly idle.  The next batch so misses what
the current step changes, which is at most the occupancy, and no more than one step of it.

On the CPU the same step runs as it is, with exactly as many samples as there are.

Of several workers each has a share of the rays and of the room.  They exchange their gradients
between going back and updating, so learning is two graphs then (distributed.py).
"""

from contextlib import contextmanager

import torch
import warp as wp

from ..data import RayBank
from .batch import Batch
from .distributed import SharedGradients
from .stage import Stage
from .surroundings import over, surrounded_cost

BETAS, EPSILON = (0.9, 0.99), 1e-15  # of Adam; the paper has 0.999
LOSS_SCALE = 1024.0  # against vanishing fp16 gradients (0.2 % of their sum); Adam doesn't see it
SEED_STRIDE = 15_485_863  # a prime: runs of a million steps stay apart
WARM_UP_SEED = 1 << 28  # the runs before a recording see rays of their own
WARM_UP_RUNS = 3  # before a graph is recorded: libraries choose their kernels there


class Step:
    """A training step of `ray_count` rays; `run` it again and again.

    Attributes:
        number: Steps done.
        error: Mean squared error of the last step.  torch [] on the device
        ray_count: Rays of a step, of all workers together.
    """

    def __init__(
        self, stage: Stage, bank: RayBank, distortion: float, samples_per_step: int, seed=0
    ):
        self.stage, self.bank, self.distortion = stage, bank, distortion
        self.samples_per_step = samples_per_step
        self.workers = stage.workers
        device = stage.torch_device
        self._white = torch.zeros(1, device=device)
        self._rate = torch.zeros((), device=device)
        # Draws and jitter follow the step's number, and are apart for each `seed`.
        self._first_seed = (seed * SEED_STRIDE) % 2**30
        self.error = torch.zeros((), device=device)
        self.optimizer = torch.optim.Adam(
            stage.parameters(),
            lr=self._rate if device.type == "cuda" else 0.0,
            betas=BETAS,
            eps=EPSILON,
            fused=True,
            capturable=device.type == "cuda",
        )
        self._shared = None
        if self.workers.count > 1:
            self._shared = SharedGradients(self.workers, stage.parameters(), self.error)
        self.number = 0
        self._batches, self._graphs = [], None
        self._stream = self._ahead = None  # of torch: to learn on, and to march ahead on
        self._next_is_marched = False
        self._warm = False

    @property
    def batch(self) -> Batch:
        """The last step's samples; before the first, the next step's."""
        return self._batches[max(self.number - 1, 0) % len(self._batches)]

    def set_ray_count(self, ray_count: int):
        """Make room for that many rays; on CUDA the next run records new graphs."""
        device = self.stage.device
        self.forget_batches()
        room, copies = (self._room(), 2) if device.is_cuda else (None, 1)
        rays = self.workers.share(ray_count)
        self._batches = [Batch(len(rays), room, device, rays.start) for _ in range(copies)]
        self.ray_count = ray_count

    def _room(self) -> int:
        """For this worker's samples."""
        return -(-self.samples_per_step // self.workers.count)

    def forget_batches(self):
        """Give the batches' memory back, and that of the graphs."""
        if self._stream is not None:
            self._stream.synchronize()
        self._batches, self._graphs, self._next_is_marched = [], None, False

    def run(self, rate: float, white: bool):
        """One step with that learning rate, on white or on random backgrounds."""
        self._white.fill_(float(white))
        if self.stage.device.is_cuda:
            self._rate.fill_(rate)
            self._run_graphs()
        else:
            for group in self.optimizer.param_groups:
                group["lr"] = rate
            self._seed_batch(self._batches[0], self.number)
            self._march(self._batches[0])
            self._learn(self._batches[0])
        self.number += 1

    def _run_graphs(self):
        if self._graphs is None:
            self._record()
        march, learn = self._graphs
        now, ahead = self.number % 2, (self.number + 1) % 2
        if not self._next_is_marched:
            self._seed_batch(self._batches[now], self.number)
            march[now].replay()
        # What is on the main stream so far is over before the march begins, what comes later
        # begins after it has ended: nobody has to know that there are two streams.
        self._ahead.wait_stream(self._stream)
        with torch.cuda.stream(self._ahead):
            self._seed_batch(self._batches[ahead], self.number + 1)
            march[ahead].replay()
        for part in learn[now]:
            part()
        self._stream.wait_stream(self._ahead)
        self._next_is_marched = True

    def state(self) -> dict:
        """What a later run needs to go on: optimiser, randomness, number of rays."""
        return {
            "optimizer": self.optimizer.state_dict()["state"],
            "number": self.number,
            "ray_count": self.ray_count,
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
        """Samples that the last step's rays had, those left out included.

        It waits for the device, and for the other workers.
        """
        ends = self.batch.ends
        return self.workers.total(int(ends[len(ends) - 1 :].numpy()[0]))

    def _seed_batch(self, batch, number):
        """Randomness for step `number`; never 0, which means no jitter."""
        wp.to_torch(batch.seed).fill_(self._first_seed + number + 1)

    def _march(self, batch):
        self.bank.draw(batch.seed, batch.drawn)
        self.stage.march(batch)

    def _learn(self, batch):
        self._go_back(batch)
        if self._shared:
            self._shared.exchange()
        self._update()

    def _go_back(self, batch):
        """Gradients and error, of this worker's rays."""
        stage = self.stage
        rgba = batch.rgba
        alpha = rgba[:, 3:]
        color, opacity, distortion, _ = stage.composite(batch)
        cost = self.distortion * distortion
        if stage.surroundings:
            target = rgba[:, :3]
            with stage.precision():
                front, behind = stage.surroundings(
                    batch.drawn.origins, batch.drawn.directions, batch.seed, batch.drawn.first
                )
            cost = surrounded_cost(self.distortion, distortion, opacity, front[1])
            color = over(front, color, opacity, behind)
        else:
            background = torch.maximum(batch.background, self._white)
            target = rgba[:, :3] * alpha + background * (1.0 - alpha)
            color = color + (1.0 - opacity[:, None]) * background
        fits = batch.fits / batch.fits.sum().clamp(min=1.0)
        error = (fits[:, None] * (color - target) ** 2).sum() / 3.0
        loss = error + (fits * cost).sum()
        self.optimizer.zero_grad(set_to_none=True)
        (loss * LOSS_SCALE).backward()
        self.error.copy_(error.detach())
        if self._shared:
            self._shared.collect(batch.fits.sum())

    def _update(self):
        if self._shared:
            self._shared.spread()
        self.optimizer.step()

    def _record(self):
        """Record the step; the runs before the first recording are steps too."""
        device = self.stage.device
        main = wp.get_stream(device)
        self._stream = torch.cuda.current_stream(self.stage.torch_device)
        if self._ahead is None:
            self._ahead = torch.cuda.Stream(self.stage.torch_device)
        if not self._warm:
            for run in range(WARM_UP_RUNS):
                batch = self._batches[run % 2]
                self._seed_batch(batch, WARM_UP_SEED + run)
                self._march(batch)
                self._learn(batch)
            self._warm = True
        march, learn, pool = [], [], None
        for batch in self._batches:
            with recording(device, main) as graph:
                self._march(batch)
            march.append(graph)
            # All that learn share one pool: they never run at the same time.
            if self._shared is None:
                with recording(device, main, pool) as graph:
                    self._learn(batch)
                learn.append([graph.replay])
            else:
                with recording(device, main, pool) as graph:
                    self._go_back(batch)
                with recording(device, main, graph.pool()) as update:
                    self._update()
                learn.append([graph.replay, self._shared.exchange, update.replay])
            pool = graph.pool()
        self._graphs = march, learn


@contextmanager
def recording(device, stream, pool=None):
    """Records what torch and Warp launch on a Warp stream, torch's current one, as a CUDA graph.

    Args:
        pool: Of a graph that never runs at the same time: to use its memory.

    Yields:
        The torch.cuda.CUDAGraph; `replay` it on any stream.
    """
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(
        graph,
        pool=pool,
        stream=wp.stream_to_torch(stream),
        capture_error_mode="thread_local",
    ):
        wp.capture_begin(device, stream=stream, external=True)
        try:
            yield graph
        finally:
            wp.capture_end(device, stream=stream)
