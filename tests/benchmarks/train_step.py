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

from deformrf.core.base import paths
from deformrf.core.base.device import start_warp
from deformrf.core.field import modelfile, unpack_mask
from deformrf.core.training import load_dataset, preset
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run.differentiable import Composite, on_warp_stream
from deformrf.core.training.run.loss import EXCESS_WEIGHT
from deformrf.core.training.run.optimization import LOSS_SCALE, Optimization, next_ray_count
from deformrf.core.training.run.training_field import TrainingField

RATE = 1e-4  # small: the field stays what it is


def trained_field(field, device):
    """A training field that goes on where a model file ended."""
    training = TrainingField(field.mesh, field.options, device)
    with torch.no_grad():
        training.table.copy_(torch.from_numpy(field.table))
        for layers, trained in (
            (training.networks.density, field.density_layers),
            (training.networks.color, field.color_layers),
        ):
            for layer, (weights, bias) in zip(layers, trained, strict=True):
                layer.weight.copy_(torch.from_numpy(weights.T.copy()))
                layer.bias.copy_(torch.from_numpy(bias))
    training.occupied = torch.from_numpy(unpack_mask(field.occupancy)).to(training.torch_device)
    training.refresh_mask()
    return training


def parts_of(run, times):
    """One step, part by part."""
    field, batch, bank = run.field, run.batch, run.bank
    start = time.perf_counter()

    def done(name):
        nonlocal start
        wp.synchronize_device(field.device)
        now = time.perf_counter()
        times.setdefault(name, []).append(1e3 * (now - start))
        start = now

    bank.draw(batch.seed, batch.drawn, limits=run._limits.of_pixels)
    rgba = batch.rgba
    done("draw")
    field.march(batch)
    done("march")
    samples = batch.samples
    with field.precision():
        features = field.encode(samples.tet, samples.bary)
    done("encode")
    sigma, values = field.evaluate(batch, features)
    done("networks")
    sums, opacity, distortion, _, _, visible = Composite.apply(
        sigma, values, samples.length, samples.t, batch.counts, batch.ends
    )
    done("composite")
    run._limits.judge(batch, opacity, visible)
    color, excess = field.color(batch, sums, opacity)
    loss = ((color - rgba[:, :3]) ** 2).mean() + run.distortion * distortion.mean()
    loss = loss + EXCESS_WEIGHT * excess.mean()
    run.optimizer.zero_grad()
    done("color and loss")
    # With one color a ray, the color network's gradients come before the sums'.
    weights = list(field.networks.parameters())
    early = list(field.networks.color.parameters()) if field.options.deferred else []
    *g_early, g_sums, g_opacity, g_distortion = torch.autograd.grad(
        LOSS_SCALE * loss, [*early, sums, opacity, distortion], retain_graph=True, allow_unused=True
    )
    done("color back")
    given = [g if g is not None else torch.zeros_like(opacity) for g in (g_opacity, g_distortion)]
    g_sigma, g_values = torch.autograd.grad(
        [sums, opacity, distortion], [sigma, values], [g_sums, *given], retain_graph=True
    )
    done("composite back")
    late = weights[: len(weights) - len(early)]
    g_features, *g_late = torch.autograd.grad(
        [sigma, values], [features, *late], [g_sigma, g_values], retain_graph=True
    )
    g_weights = [*g_late, *g_early]
    done("networks back")
    (field.table.grad,) = torch.autograd.grad(features, [field.table], [g_features])
    done("encode back")
    for parameter, gradient in zip(weights, g_weights, strict=True):
        parameter.grad = gradient
    run.optimizer.step()
    run._limits.keep(batch)
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
        training = trained_field(field, arguments.device)
        bank = RayBank(views, field.world_to_model, arguments.device)
        run = Optimization(training, bank, options, views.has_alpha, arguments.steps, 1.0)
        ray_count = 1 << 10
        for _ in range(8):
            run.set_ray_count(ray_count)
            run.step(RATE, white=False)
            ray_count = next_ray_count(ray_count, run.sample_count(), options.samples_per_step)
        whole, parts = [], {}
        for _ in range(arguments.steps):
            wp.synchronize_device(training.device)
            start = time.perf_counter()
            run.step(RATE, white=False)
            wp.synchronize_device(training.device)
            whole.append(1e3 * (time.perf_counter() - start))
        for _ in range(arguments.steps):
            parts_of(run, parts)
        print(f"{training.device.name}: {run.sample_count()} samples of {run.ray_count} rays")
        names = {**{name: np.median(values) for name, values in parts.items()}}
        names |= {"sum": sum(names.values()), "as run": np.median(whole)}
        print("".join(f"{name:>16}" for name in names))
        print("".join(f"{value:>16.2f}" for value in names.values()))


if __name__ == "__main__":
    main()
