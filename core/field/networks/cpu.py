"""The networks on a CPU, in float32: native code, block by block in registers (layers.h).

Shapes: N samples, l <= L levels, F features per level.
"""

from pathlib import Path

import numpy as np
import warp as wp

from ...native import native_source
from .reference import BASIS_COUNT, GEOMETRY_FEATURES, MAX_LOG_SIGMA, Layers, basis_vector

LEAST_WIDTH = 16  # rows of weights are a multiple of it: lanes of the widest vector
NETWORK_BLOCK = 48  # samples that pass the layers together; a multiple of layers.h's ROWS
LAYERS_H = Path(__file__).parent / "layers.h"
NATIVE_VALUES = {
    "BLOCK": NETWORK_BLOCK,
    "GEOMETRY_FEATURES": GEOMETRY_FEATURES,
    "BASIS_COUNT": BASIS_COUNT,
    "MAX_LOG_SIGMA": f"{MAX_LOG_SIGMA}f",
}


@wp.struct
class NativeNetworks:
    """Both networks; columns of weights are filled up with zeros."""

    values: wp.array(dtype=float)  # weights [in, width] and bias [width] of each layer
    shapes: wp.array(dtype=int)  # of each layer: in, width, where its weights and bias begin
    density_count: int  # layers
    color_count: int
    widest: int  # of all layers


def native_networks(density_layers: Layers, color_layers: Layers) -> NativeNetworks:
    """Copy the layers to where native code finds them."""
    values, shapes, start = [], [], 0
    for weights, bias in (*density_layers, *color_layers):
        missing = -len(bias) % LEAST_WIDTH
        weights = np.pad(weights, ((0, 0), (0, missing)))
        bias = np.pad(bias, (0, missing))
        shapes.append((*weights.shape, start, start + weights.size))
        values += [weights.ravel(), bias]
        start += weights.size + bias.size
    networks = NativeNetworks()
    networks.values = wp.array(np.concatenate(values), dtype=float, device="cpu")
    networks.shapes = wp.array(np.ravel(shapes).astype(np.int32), dtype=int, device="cpu")
    networks.density_count, networks.color_count = len(density_layers), len(color_layers)
    networks.widest = max(width for _, width, *_ in shapes)
    return networks


@wp.func_native(native_source(Path(__file__).parent / "cpu.cpp", [LAYERS_H], NATIVE_VALUES))
def evaluate_native(
    networks: NativeNetworks,
    features: wp.array2d(dtype=wp.vec4),
    basis: wp.array(dtype=basis_vector),
    scratch: wp.array(dtype=float),
    sigma: wp.array(dtype=float),
    rgb: wp.array(dtype=wp.vec3),
): ...


@wp.kernel(enable_backward=False)
def evaluate_kernel(
    networks: NativeNetworks,
    features: wp.array2d(dtype=wp.vec4),  # [N, l]
    basis: wp.array(dtype=basis_vector),  # [N]
    scratch: wp.array(dtype=float),
    sigma: wp.array(dtype=float),  # [N] out
    rgb: wp.array(dtype=wp.vec3),  # [N] out
):
    """`reference.evaluate` for all samples, by one thread."""
    evaluate_native(networks, features, basis, scratch, sigma, rgb)


def evaluate_on_cpu(networks: NativeNetworks, features, basis):
    """sigma [N] and rgb [N] of samples, from features [N, l] and Y(d) [N] in the CPU's memory."""
    count, level_count = features.shape
    sigma = wp.empty(count, dtype=float, device="cpu")
    rgb = wp.empty(count, dtype=wp.vec3, device="cpu")
    width = 2 * networks.widest + 4 * level_count + GEOMETRY_FEATURES + BASIS_COUNT
    scratch = wp.empty(NETWORK_BLOCK * width, dtype=float, device="cpu")
    inputs = [networks, features, basis, scratch]
    wp.launch(evaluate_kernel, 1, inputs, [sigma, rgb], device="cpu")
    return sigma, rgb
