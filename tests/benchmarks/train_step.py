"""Where the time of a training step goes, on a trained model's mesh and data.

    python tests/benchmarks/train_step.py DATA [--model M] [--device cuda:0] [--steps 40]

Medians in ms.  The parts are run one after another with a wait behind each; `as run` is the
step as training runs it, on CUDA a recorded graph.
"""

import argparse
import time

import numpy as np
import torch
import warp as wp

from deformrf.core import paths
from deformrf.core.device import start_warp
from deformrf.core.field import modelfile
from deformrf.core.field.occupancy import unpack_mask
from deformrf.core.training import load_dataset, preset
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run.differentiable import Composite, on_warp_stream
from deformrf.core.training.run.fit import next_ray_count
from deformrf.core.training.run.stage import Stage
from deformrf.core.training.run.step import LOSS_SCALE, Step

RATE = 1e-4  # small: the field stays what it is


def trained_stage(field, device):
    """A stage that goes on where a model file ended."""
    stage = Stage(field.mesh, field.options, device)
    with torch.no_grad():
        stage.table.copy_(torch.from_numpy(field.table))
        for layers, trained in (
            (stage.networks.density, field.density_layers),
            (stage.networks.color, field.color_layers),
        ):
            for layer, (weights, bias) in zip(layers, trained, strict=True):
                layer.weight.copy_(torch.from_numpy(weights.T.copy()))
                layer.bias.copy_(torch.from_numpy(bias))
    stage.occupied = torch.from_numpy(unpack_mask(field.occupancy)).to(stage.torch_device)
    stage.refresh_mask()
    return stage


def parts_of(step, times):
    """One step, part by part."""
    stage, batch, bank = step.stage, step.batch, step.bank
    start = time.perf_counter()

    def done(name):
        nonlocal start
        wp.synchronize_device(stage.device)
        now = time.perf_counter()
        times.setdefault(name, []).append(1e3 * (now - start))
        start = now

    bank.draw(batch.seed, batch.drawn)
    rgba = batch.rgba
    done("draw")
    stage.march(batch)
    done("march")
    samples = batch.samples
    with stage.precision():
        features = stage.encode(samples.tet, samples.bary)
        done("encode")
        sigma, rgb = stage.networks.evaluate(features, batch.basis, wp.to_torch(batch.sample_count))
        done("networks")
    color, _, distortion, _ = Composite.apply(
        sigma, rgb, samples.length, samples.t, batch.counts, batch.ends
    )
    done("composite")
    loss = ((color - rgba[:, :3]) ** 2).mean() + step.distortion * distortion.mean()
    step.optimizer.zero_grad(set_to_none=True)
    done("loss")
    g_sigma, g_rgb = torch.autograd.grad(LOSS_SCALE * loss, [sigma, rgb], retain_graph=True)
    done("composite back")
    weights = list(stage.networks.parameters())
    g_features, *g_weights = torch.autograd.grad(
        [sigma, rgb], [features, *weights], [g_sigma, g_rgb], retain_graph=True
    )
    done("networks back")
    (stage.table.grad,) = torch.autograd.grad(features, [stage.table], [g_features])
    done("encode back")
    for parameter, gradient in zip(weights, g_weights, strict=True):
        parameter.grad = gradient
    step.optimizer.step()
    done("adam")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data")
    parser.add_argument("--model", default=paths.DEFAULT_MODEL)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--steps", type=int, default=40)
    arguments = parser.parse_args()
    start_warp()
    field = modelfile.load(arguments.model)
    options = preset("default" if arguments.device.startswith("cuda") else "tiny")
    views = load_dataset(arguments.data, "train", view_count=20)
    with on_warp_stream(arguments.device):
        stage = trained_stage(field, arguments.device)
        bank = RayBank(views, field.world_to_model, arguments.device)
        step = Step(stage, bank, options.distortion, options.samples_per_step)
        ray_count = 1 << 10
        for _ in range(8):
            step.set_ray_count(ray_count)
            step.run(RATE, white=False)
            ray_count = next_ray_count(ray_count, step.sample_count(), options.samples_per_step)
        whole, parts = [], {}
        for _ in range(arguments.steps):
            wp.synchronize_device(stage.device)
            start = time.perf_counter()
            step.run(RATE, white=False)
            wp.synchronize_device(stage.device)
            whole.append(1e3 * (time.perf_counter() - start))
        for _ in range(arguments.steps):
            parts_of(step, parts)
        print(f"{stage.device.name}: {step.sample_count()} samples of {step.ray_count} rays")
        names = {**{name: np.median(values) for name, values in parts.items()}}
        names |= {"sum": sum(names.values()), "as run": np.median(whole)}
        print("".join(f"{name:>16}" for name in names))
        print("".join(f"{value:>16.2f}" for value in names.values()))


if __name__ == "__main__":
    main()
