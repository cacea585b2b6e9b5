"""Both networks fused: one Triton kernel forward and one backward, for training on CUDA.

The layers of `network.py`, for hidden widths of 64 and N samples, one below the other
(`act` is ReLU or sigmoid; a2 and a3 only where the density network has them):

    a1 = act(W x + b)                    x: features, L·F columns
    a2 = act(W a1 + b), a3 = act(W a2 + b)
    h = W a + b                          sigma = exp(min(h_0, 15))
    c1 = relu(W [h, y] + b)              y: spherical harmonics of the direction
    c2 = relu(W c1 + b)
    rgb = sigmoid(W c2 + b)

A program keeps the weights and takes one block of samples after another; what lies between
two layers never leaves the chip.  The backward kernel computes the hidden layers again from
x and y, keeps the weights' gradients in registers over all its blocks and writes them once,
as one row of partial sums; the rows are added up in a fixed order, so gradients are the same
from run to run.  `g_` is the gradient of the loss by what follows it.

**Precision.**  Weights, x, y and hidden layers are rounded to float16, as tensor cores want
them; every sum is float32, and so are biases, h_0 on its way to sigma, both outputs, and
the gradients that come in and go out (those of float16 features are float16).  Between the
layers gradients are float16 too.  They stay in its range whatever the loss is scaled by: at
the end of each network a block divides its gradients by a unit of its own, 1/16 of the
largest, and multiplies by it, in float32, what it adds up.  On their way through the
network they may grow 4000-fold, and saturate instead of overflowing; they have all 11 bits
down to 2^-18 of the largest, and vanish below 2^-29 of it.  A sigmoid layer's derivative
comes from its rounded output, as torch's does.

Nothing waits for the host and the grid follows from shapes alone, so a CUDA graph can hold
it.  Triton comes with torch for CUDA on Linux; where it is missing `can_fuse` says no, and
`network_torch.py` is there.
"""

from dataclasses import dataclass
from functools import partial

import torch
from torch.autograd.function import once_differentiable

from .reference import BASIS_COUNT
from .torch import ACTIVATIONS, Networks

try:
    from . import triton_kernels as kernels
except ImportError:  # no Triton
    kernels = None

WIDTH = 64  # of every hidden layer
DENSITY_HIDDEN = (1, 2, 3)  # how many of them the kernels know
COLOR_HIDDEN = 2
MAX_FEATURES = 32  # L·F
OLDEST_GPU = (8, 0)  # compute capability
INTERPRETER_PROGRAMS = 3  # where Triton's interpreter runs the kernels, on the CPU


@dataclass(frozen=True)
class Launch:
    """How a kernel is spread over a GPU.

    Attributes:
        block: Samples that a program does at once.
        warps: Of a program.
        stages: Blocks whose samples are loaded ahead, and the one that is worked on.
        programs: At most that many for each of the GPU's processors.
    """

    block: int
    warps: int
    stages: int
    programs: int


# By registers, shared memory (99 KB on most GPUs) and spills of what Triton compiles; large
# blocks of the backward kernel are for Hopper (on 10.0 Triton silently makes a trap of them).
FORWARD = Launch(block=64, warps=4, stages=3, programs=4)
BACKWARD = Launch(block=32, warps=4, stages=1, programs=1)
BACKWARD_HOPPER = Launch(block=128, warps=8, stages=1, programs=1)
HOPPER = (9, 0)  # compute capability


class Fused(torch.autograd.Function):
    """sigma [N] and rgb [N, 3]; differentiable in the features and the packed parameters."""

    @staticmethod
    def forward(ctx, features, basis, parameters, sample_count, middle, sigmoid):
        features, basis = features.contiguous(), basis.contiguous()
        room = len(features)
        sigma = torch.empty(room, device=features.device)
        rgb = torch.empty(room, 3, device=features.device)
        counter = features if sample_count is None else sample_count
        shape = {
            "FEATURES": features.shape[1],
            "MIDDLE": middle,
            "SIGMOID": sigmoid,
            "COUNTED": sample_count is not None,
        }
        with torch.cuda.device_of(features):
            _launch(
                kernels.forward_kernel,
                FORWARD,
                *(features, basis, parameters, counter, sigma, rgb),
                **shape,
            )
        ctx.save_for_backward(features, basis, parameters, counter)
        ctx.shape = shape
        return sigma, rgb

    @staticmethod
    @once_differentiable
    def backward(ctx, g_sigma, g_rgb):
        features, basis, parameters, counter = ctx.saved_tensors
        g_sigma, g_rgb = g_sigma.contiguous(), g_rgb.contiguous()
        g_features = torch.empty_like(features)
        launch = _backward_launch(features.device)
        partial = torch.empty(
            _program_count(features, launch), len(parameters), device=features.device
        )
        with torch.cuda.device_of(features):
            _launch(
                kernels.backward_kernel,
                launch,
                *(features, basis, parameters, counter, g_sigma, g_rgb, g_features, partial),
                PARAMETERS=len(parameters),
                **ctx.shape,
            )
        g_parameters = partial.sum(dim=0).to(parameters.dtype)
        return g_features, None, g_parameters, None, None, None


def _launch(kernel, launch: Launch, features, *arrays, **shape):
    kernel[(_program_count(features, launch),)](
        *(features, *arrays, len(features)),
        **shape,
        BLOCK=launch.block,
        num_warps=launch.warps,
        num_stages=launch.stages,
    )


def _program_count(features, launch: Launch) -> int:
    """One for each block of samples, but no more than run side by side; at least one."""
    most = INTERPRETER_PROGRAMS
    if features.is_cuda:
        processors = torch.cuda.get_device_properties(features.device).multi_processor_count
        most = launch.programs * processors
    return max(1, min(most, -(-len(features) // launch.block)))


def _backward_launch(device) -> Launch:
    if device.type == "cuda" and torch.cuda.get_device_capability(device) == HOPPER:
        return BACKWARD_HOPPER
    return BACKWARD


def pack(networks: Networks):
    """All parameters one after another: density, then color, weights [out, in], then bias."""
    return torch.cat(
        [
            parameter.flatten()
            for layer in (*networks.density, *networks.color)
            for parameter in (layer.weight, layer.bias)
        ]
    )


def can_fuse(networks: Networks) -> bool:
    """Whether `evaluate` can do these networks where they are."""
    hidden = [*networks.density[:-1], *networks.color[:-1]]
    device = networks.density[0].weight.device
    return (
        kernels is not None
        and device.type == "cuda"
        and torch.cuda.get_device_capability(device) >= OLDEST_GPU
        and len(networks.density) - 1 in DENSITY_HIDDEN
        and len(networks.color) - 1 == COLOR_HIDDEN
        and all(layer.out_features == WIDTH for layer in hidden)
        and networks.density[0].in_features <= MAX_FEATURES
        and networks.activation in ACTIVATIONS.values()
    )


def evaluator(networks: Networks):
    """The fastest way to evaluate these networks with gradients: `evaluate`, or torch's layers.

    Returns:
        A function of features, basis and sample_count, as `evaluate` without its networks.
    """
    if can_fuse(networks):
        return partial(evaluate, networks)
    return lambda features, basis, _sample_count=None: networks(features, basis)


def launch_forward(networks: Networks, parameters, features, basis, sample_count, sigma, rgb):
    """`evaluate` without gradients, into arrays that are there: nothing is allocated.

    Args:
        parameters: `pack(networks)`.
        sample_count: int32 [1], on the device.
        sigma, rgb: float32 [N], [N, 3], out.
    """
    _launch(
        kernels.forward_kernel,
        FORWARD,
        *(features, basis, parameters, sample_count, sigma, rgb),
        FEATURES=features.shape[1],
        MIDDLE=len(networks.density) - 2,
        SIGMOID=networks.activation is ACTIVATIONS["sigmoid"],
        COUNTED=True,
    )


def evaluate(networks: Networks, features, basis, sample_count=None):
    """Density and color of samples, as `networks(features, basis)`.

    Args:
        features: Encoding, float32 or float16.  [N, L·F]
        basis: spherical_harmonics of the samples' directions.  [N, 16]
        sample_count: How many of the N there are, on the device; the others cost nothing,
            give nothing to the gradients, and have no values: neither in what is returned
            nor in the features' gradients.  torch int32 [1], or None for all

    Returns:
        sigma [N] per unit of rest length and rgb [N, 3], both float32.
    """
    assert features.shape[1] == networks.density[0].in_features, features.shape
    assert basis.shape == (len(features), BASIS_COUNT), basis.shape
    assert len(features) * MAX_FEATURES < 2**31, f"{len(features)}: offsets have 32 bits"
    middle = len(networks.density) - 2
    sigmoid = networks.activation is ACTIVATIONS["sigmoid"]
    return Fused.apply(features, basis, pack(networks), sample_count, middle, sigmoid)
