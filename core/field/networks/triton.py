"""Both networks fused: one Triton kernel forward and one backward, for training on CUDA.

The networks must have the usual shape, with hidden layers of 64, or narrower ones, which are filled
up with zeros (`widened`).  The kernels compute for N samples

    a = relu(W x + b)                    x: features, L·F columns
    h = W a + b                          sigma = exp(min(h_0, 15))
    c1 = relu(W [h, y] + b)              y: spherical harmonics of the direction
    c2 = relu(W c1 + b)
    rgb = sigmoid(W c2 + b)

A Triton program loads the weights once and processes one block of samples after another; hidden
layers never leave the chip.  The backward kernel computes them again from x and y.  It sums the
weights' gradients in registers over all its blocks, then writes them once, as one row of partial
sums.  The rows are added in a fixed order, so gradients are the same from run to run.  `g_x` is
the gradient of the loss by x.

**Precision.**  The kernels round weights, x, y and hidden layers to float16 for the tensor
cores.  Sums, biases, h_0 on its way to sigma, both outputs, and incoming and outgoing gradients are
float32 (gradients of float16 features are float16).  Between the layers, gradients are float16,
scaled so that any scale of the loss fits.  At the output of each network, a block divides its
gradients by 1/16 of the largest of them; in the end it multiplies the sums by this unit again, in
float32.  So gradients may grow 4000-fold on their way through the network before they saturate.
They have all 11 bits down to 2^-18 of the largest, and become 0 below 2^-29 of it.

If each ray has one color, `evaluate_density` computes the first two lines, and torch the rest.

No launch waits for the host, and the grid follows from shapes alone, so a CUDA graph can record
the launches.  Torch for CUDA on Linux includes Triton; without it `fits` is false and
torch.py evaluates the layers.
"""

from dataclasses import dataclass

import torch
from torch.autograd.function import once_differentiable
from torch.nn.functional import pad

from .basis import BASIS_COUNT
from .shapes import GEOMETRY_FEATURES, MAX_FEATURES, WIDTH, fits_usual_shape, has_usual_density
from .torch import TorchNetworks

try:
    from . import triton_kernels as kernels
except ImportError:  # no Triton
    kernels = None

OLDEST_GPU = (8, 0)  # compute capability
HOPPER = (9, 0)
INTERPRETER_PROGRAMS = 3  # where Triton's interpreter runs the kernels, on the CPU


@dataclass(frozen=True)
class Launch:
    """Launch parameters of a kernel."""

    block: int  # samples that a program takes at once
    warps: int  # per program
    stages: int  # blocks whose samples are in flight, the present one included
    programs: int  # per processor, at most


# Chosen by registers, shared memory (99 KB on most GPUs) and spills of the compiled kernels.
# Blocks of 128 are for Hopper: for 10.0 Triton compiles that kernel to a trap without a word.
FORWARD = Launch(block=64, warps=4, stages=3, programs=4)
BACKWARD = Launch(block=32, warps=4, stages=1, programs=1)
BACKWARD_HOPPER = Launch(block=128, warps=8, stages=1, programs=1)


def fits(networks: TorchNetworks) -> bool:
    """Whether `evaluate` takes these networks on the device where they are."""
    return _runs_on(networks) and fits_usual_shape(_shapes(networks.density, networks.color))


def density_fits(networks: TorchNetworks) -> bool:
    """Whether `evaluate_density` takes these networks on the device where they are."""
    return _runs_on(networks) and has_usual_density(_shapes(networks.density))


def _runs_on(networks):
    device = networks.density[0].weight.device
    return (
        kernels is not None
        and device.type == "cuda"
        and torch.cuda.get_device_capability(device) >= OLDEST_GPU
    )


def _shapes(*networks):
    return [(layer.in_features, layer.out_features) for network in networks for layer in network]


def pack(layers):
    """The layers' parameters one after another: weights [out, in], then bias."""
    return torch.cat([p.flatten() for layer in layers for p in layer])


def widened(networks: TorchNetworks) -> list:
    """Weights and bias of each layer, differentiable, in the usual shape.

    Units that are missing are 0.  A second hidden layer of the color network that is missing passes
    on what it gets, which no ReLU changes, since it is a ReLU's.
    """
    density, color = (
        [(layer.weight, layer.bias) for layer in layers]
        for layers in (networks.density, networks.color)
    )
    if len(color) == 2:
        unit = torch.eye(WIDTH, device=color[0][0].device)
        color.insert(1, (unit, unit.new_zeros(WIDTH)))
    last, wide = (0, len(density)), []
    for number, (weight, bias) in enumerate(density + color):
        rows, columns = weight.shape
        is_hidden = number not in (len(density) - 1, len(density) + len(color) - 1)
        more = WIDTH - rows if is_hidden else 0
        fill = 0 if number in last else WIDTH - columns
        wide.append((pad(weight, (0, fill, 0, more)), pad(bias, (0, more))))
    return wide


def evaluate_density(networks: TorchNetworks, features, sample_count=None):
    """The density network alone, otherwise as `evaluate`.

    Returns:
        sigma [N] per unit of rest length and h [N, 16], both float32.
    """
    count = _checked_count(networks, features, sample_count)
    both = kernels.density_kernel, kernels.density_backward_kernel
    parameters = pack((layer.weight, layer.bias) for layer in networks.density)
    return Fused.apply(*both, GEOMETRY_FEATURES, features, parameters, count)


def evaluate(networks: TorchNetworks, features, basis, sample_count=None):
    """Density and color of samples with gradients, as `networks(features, basis)`.

    Args:
        features: Encoding, float32 or float16.  [N, L·F]
        basis: Spherical harmonics of the samples' directions.  [N, 16]
        sample_count: Number of existing samples, at most N, int32 [1] on the device; None for all.
            The others cost nothing and add nothing to the parameters' gradients.  Their
            outputs and their features' gradients are not written.

    Returns:
        sigma [N] per unit of rest length and rgb [N, 3], both float32.
    """
    assert basis.shape == (len(features), BASIS_COUNT), basis.shape
    count = _checked_count(networks, features, sample_count)
    both = kernels.forward_kernel, kernels.backward_kernel
    parameters = pack(widened(networks))
    return Fused.apply(*both, 3, features, basis.contiguous(), parameters, count)


def _checked_count(networks, features, sample_count):
    """int32 [1]"""
    count = len(features)
    assert features.shape[1] == networks.density[0].in_features, features.shape
    assert count * MAX_FEATURES < 2**31, f"{count} samples: offsets have 32 bits"
    if sample_count is None:
        return torch.full((1,), count, dtype=torch.int32, device=features.device)
    return sample_count


class Fused(torch.autograd.Function):
    """Two outputs of a kernel, [N] and [N, columns]; differentiable in features and parameters.

    `arrays` are what the kernel takes behind the features: the parameters are last but one, and
    the number of samples is last.
    """

    @staticmethod
    def forward(ctx, kernel, backward_kernel, columns, features, *arrays):
        features = features.contiguous()
        sigma = torch.empty(len(features), device=features.device)
        values = torch.empty(len(features), columns, device=features.device)
        _launch(kernel, FORWARD, features, *arrays, sigma, values)
        ctx.save_for_backward(features, *arrays)
        ctx.kernel = backward_kernel
        return sigma, values

    @staticmethod
    @once_differentiable
    def backward(ctx, g_sigma, g_values):
        features, *others, parameters, _sample_count = ctx.saved_tensors
        hopper = features.is_cuda and torch.cuda.get_device_capability(features.device) == HOPPER
        launch = BACKWARD_HOPPER if hopper else BACKWARD
        g_features = torch.empty_like(features)
        programs = _program_count(features, launch)
        partial = torch.empty(programs, len(parameters), device=features.device)
        gradients = g_sigma.contiguous(), g_values.contiguous()
        arrays = *ctx.saved_tensors, *gradients, g_features, partial
        _launch(ctx.kernel, launch, *arrays, PARAMETERS=len(parameters))
        g_parameters = partial.sum(dim=0).to(parameters.dtype)
        return None, None, None, g_features, *[None] * len(others), g_parameters, None


def _launch(kernel, launch: Launch, features, *arrays, **constants):
    with torch.cuda.device_of(features):
        kernel[(_program_count(features, launch),)](
            features,
            *arrays,
            len(features),
            FEATURES=features.shape[1],
            **constants,
            BLOCK=launch.block,
            num_warps=launch.warps,
            num_stages=launch.stages,
        )


def _program_count(features, launch: Launch) -> int:
    """One program per block of samples, at least one, and no more than run side by side."""
    most = INTERPRETER_PROGRAMS
    if features.is_cuda:
        processors = torch.cuda.get_device_properties(features.device).multi_processor_count
        most = launch.programs * processors
    return max(1, min(most, -(-len(features) // launch.block)))
