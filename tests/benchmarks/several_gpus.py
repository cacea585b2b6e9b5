"""Training speed with one GPU or several: samples per second, and where a step's time goes.

    python tests/benchmarks/several_gpus.py --data DATA
    torchrun --nproc-per-node 2 tests/benchmarks/several_gpus.py --data DATA [--preset fast]
        [--ahead 1 2 3] [--seconds 2] [--collectives]

Stage 1 is trained in full and stage 2 for a moment, so that mesh, occupancy and ray count are
those of a run.  Then, for each number of batches that are marched ahead:

    as run      ms per step and samples per second of training, its pauses included
    parts       ms per step between CUDA events.  `march` is the time that one batch is under
                way on its own stream; the other parts follow each other on the main stream.

With --collectives GPUs that could use each other's memory exchange by collectives all the same.
Samples per step are those of all GPUs together, so figures of 1 and of N processes compare.
"""

import argparse
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import torch

from deformrf.core.base.device import device_name, start_warp
from deformrf.core.training import (
    load_dataset,
    preset,
    stages,
    torchrun_workers,
    trainer,
    world_to_unit_cube,
)
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.data.scene_box import object_box
from deformrf.core.training.run import optimization, recorded_steps
from deformrf.core.training.run.batch import looks
from deformrf.core.training.run.differentiable import on_warp_stream
from deformrf.core.training.run.exchange import Exchange
from deformrf.core.training.run.monitoring import TrainingProgress
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.training_field import TrainingField

SETTLING_STEPS = 512  # of stage 2, before it is measured
MEASURED_STEPS = 160  # for the parts


def fine_run(views, options, device, workers, progress):
    """The optimization of stage 2 after a whole stage 1 and SETTLING_STEPS of its own."""
    world_to_model = world_to_unit_cube(views, options.aabb, options.scene_radius)
    box = object_box(world_to_model, options.aabb)
    bank = RayBank(views, world_to_model, device)
    mesh = trainer.boxed(trainer.a15_grid(options.spacing), box, options.spacing)
    field = TrainingField(mesh, stages.coarse_options(options), device, workers=workers)
    coarse = Optimization(
        field, bank, options, views.has_alpha, options.coarse_steps, stages.FINAL_RATES[1]
    )
    coarse.run(progress, "stage 1")
    field.update_occupancy()
    most = trainer.COARSE_LOOK * options.samples_per_step
    field.hide_unseen(partial(looks, bank, field.device, most), trainer.COARSE_UNSEEN_WEIGHT)
    mesh = trainer.kept_mesh(field)
    field = TrainingField(mesh, stages.field_options(options), device, workers=workers)
    fine = Optimization(
        field, bank, options, views.has_alpha, SETTLING_STEPS, stages.FINAL_RATES[2]
    )
    fine.run(progress, "stage 2")
    return fine


def as_run(run, progress, seconds):
    """ms and samples of a step of training, means over at least that many seconds."""
    steps, elapsed, counts, examine = 0, 0.0, [], run._examine

    def examined(*arguments):
        counts.append(examine(*arguments))
        return counts[-1]

    run._examine = examined
    while elapsed < seconds:
        run.step_count += SETTLING_STEPS
        torch.cuda.synchronize()
        begin = time.perf_counter()
        first = run.number
        run.run(progress, "measured")
        torch.cuda.synchronize()
        elapsed += time.perf_counter() - begin
        steps += run.number - first
        elapsed = run.workers.total(int(1e6 * elapsed)) / 1e6 / run.workers.count
    run._examine = examine
    return 1e3 * elapsed / steps, float(np.mean(counts))


def timed(function, times):
    """The function with an event before and one behind, on the current stream."""

    def call():
        start, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        start.record()
        function()
        end.record()
        times.append((start, end))

    return call


def parts(run):
    """Mean ms of each part of a step."""
    run.step(1e-4, white=True)
    recorded, times = run._recorded, {"march": []}
    recorded._march = [
        SimpleNamespace(replay=timed(graph.replay, times["march"])) for graph in recorded._march
    ]
    for index, learn in enumerate(recorded.learn):
        recorded.learn[index] = {
            name: timed(part, times.setdefault(name, [])) for name, part in learn.items()
        }
    for _ in range(MEASURED_STEPS):
        run.step(1e-4, white=True)
    torch.cuda.synchronize()
    run.set_ray_count(run.ray_count)  # the recording with its events goes
    return {
        name: float(np.mean([start.elapsed_time(end) for start, end in pairs]))
        for name, pairs in times.items()
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", required=True)
    parser.add_argument("--preset", default="fast")
    parser.add_argument("--image-size", type=int)
    parser.add_argument("--ahead", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--collectives", action="store_true")
    arguments = parser.parse_args()
    if arguments.collectives:
        optimization.make_exchange = Exchange
    start_warp()
    device = device_name("cuda", for_training=True)
    options = preset(arguments.preset)
    views = load_dataset(arguments.data, "train", arguments.image_size)
    with (
        torchrun_workers(device) as workers,
        on_warp_stream(device),
        TrainingProgress(False) as progress,
    ):
        begin = time.perf_counter()
        run = fine_run(views, options, device, workers, progress)
        if workers.is_first:
            steps = options.coarse_steps + run.number
            print(f"{steps} steps from the start: {time.perf_counter() - begin:.1f} s")
        for ahead in arguments.ahead:
            recorded_steps.AHEAD = ahead
            run.set_ray_count(run.ray_count, int(optimization.RAY_SPACE * run.ray_count))
            run.step(1e-4, white=True)  # records
            ms, samples = as_run(run, progress, arguments.seconds)
            shares = parts(run)
            if not workers.is_first:
                continue
            print(
                f"{workers.count} x {torch.cuda.get_device_name()}, {ahead} ahead: "
                f"{samples:.0f} samples of {run.ray_count} rays, {ms:.3f} ms a step, "
                f"{samples / ms / 1e3:.1f} M samples/s"
            )
            print("    " + ", ".join(f"{name} {value:.3f}" for name, value in shares.items()))


if __name__ == "__main__":
    main()
