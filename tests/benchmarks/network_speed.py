"""Milliseconds of the networks: torch's float16 layers beside the fused kernels.

    python tests/benchmarks/network_speed.py [--samples 262144 4194304] [--used 1.0]
        [--forward BLOCK WARPS STAGES PROGRAMS] [--backward BLOCK WARPS STAGES PROGRAMS]

Medians of single calls between two events; CUDA only.  Beside each time is the largest error
against the same layers in float32 on as many samples as fit a check: of rgb forward, and
with backward of the gradients, each tensor's by its norm.  --used is the share of the
samples that exist, which only the fused kernels can make use of.  --forward and --backward
try other launches than those of core/field/networks/triton.py.
"""

import argparse
from dataclasses import fields

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from deformrf.core.field import FieldOptions, TorchNetworks
from deformrf.core.field.field import layer_widths
from deformrf.core.field.networks import triton as fused
from deformrf.core.training.run.optimization import LOSS_SCALE

RUNS, WARM_UP_RUNS = 30, 5
CHECKED = 1 << 18  # samples of which errors are measured
RAYS = 1 << 12  # a sample's gradient is about that much smaller than the loss


def make_networks():
    rng = np.random.default_rng(1)

    def layers(widths):
        bound = [np.sqrt(6.0 / fan_in) for fan_in in widths[:-1]]
        return tuple(
            (rng.uniform(-b, b, (i, o)).astype(np.float32), np.zeros(o, np.float32))
            for b, i, o in zip(bound, widths[:-1], widths[1:], strict=True)
        )

    density, color = (layers(widths) for widths in layer_widths(FieldOptions()))
    return TorchNetworks(density, color).to("cuda:0")


def make_samples(count):
    """features, basis, gradients of sigma and of rgb as large as in training."""
    x, y, g_sigma, g_rgb = (torch.randn(count, n, device="cuda:0") for n in (24, 16, 1, 3))
    scale = 0.1 * LOSS_SCALE / RAYS
    return x.requires_grad_(), y, scale * g_sigma[:, 0], scale * g_rgb


def layers_in(dtype):
    """Torch's layers as training runs them, or in float32."""

    def evaluate(networks, x, y, _counter):
        with torch.autocast("cuda", torch.float16, dtype == torch.float16, cache_enabled=False):
            return networks(x, y)

    return evaluate


def gradients(evaluate, networks, x, y, counter, given):
    return torch.autograd.grad(
        evaluate(networks, x, y, counter), [x, *networks.parameters()], given
    )


def median_time(work):
    """In ms."""
    for _ in range(WARM_UP_RUNS):
        work()
    times = []
    for _ in range(RUNS):
        start, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        start.record()
        work()
        end.record()
        end.synchronize()
        times.append(start.elapsed_time(end))
    return float(np.median(times))


def errors(evaluate, networks, x, y, given):
    """Of rgb, and of the gradients: the largest ones."""
    x = x[:CHECKED].detach().requires_grad_()
    y, given = y[:CHECKED], [g[:CHECKED] for g in given]
    exact = layers_in(torch.float32)
    with torch.no_grad():
        rgb = (evaluate(networks, x, y, None)[1] - exact(networks, x, y, None)[1]).abs().max()
    ours = gradients(evaluate, networks, x, y, None, given)
    expected = gradients(exact, networks, x, y, None, given)
    by_norm = [(a - b).norm() / b.norm() for a, b in zip(ours, expected, strict=True)]
    return float(rgb), float(max(by_norm))


def measure(table, count, used):
    networks = make_networks()
    x, y, *given = make_samples(count)
    counter = torch.tensor([int(count * used)], dtype=torch.int32, device="cuda:0")
    ways = {"torch float16": layers_in(torch.float16)}
    if fused.fits(networks):
        ways["fused"] = fused.evaluate
    for name, evaluate in ways.items():
        with torch.no_grad():
            forward = median_time(lambda way=evaluate: way(networks, x, y, counter))
        both = median_time(lambda way=evaluate: gradients(way, networks, x, y, counter, given))
        rgb, by_norm = errors(evaluate, networks, x, y, given)
        table.add_row(
            f"{count:,}",
            name,
            f"{forward:.3f}",
            f"{rgb:.1e}",
            f"{both:.3f}",
            f"{by_norm:.1e}",
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, nargs="+", default=[1 << 18, 1 << 22])
    parser.add_argument("--used", type=float, default=1.0)
    launch = tuple(field.name.upper() for field in fields(fused.Launch))
    parser.add_argument("--forward", type=int, nargs=4, metavar=launch)
    parser.add_argument("--backward", type=int, nargs=4, metavar=launch)
    arguments = parser.parse_args()
    if not torch.cuda.is_available():
        parser.error("there is no CUDA device, and elsewhere there are no fused networks")
    if arguments.forward:
        fused.FORWARD = fused.Launch(*arguments.forward)
    if arguments.backward:
        own = fused.Launch(*arguments.backward)
        fused.BACKWARD = fused.BACKWARD_HOPPER = own
    table = Table(title=f"{torch.cuda.get_device_name()}: ms, and the largest error")
    for column in ("samples", "way"):
        table.add_column(column)
    for column in ("forward", "of rgb", "and backward", "of gradients"):
        table.add_column(column, justify="right")
    for count in arguments.samples:
        measure(table, count, arguments.used)
    Console().print(table)


if __name__ == "__main__":
    main()
