"""The networks on a CPU: native code, block by block in registers (layers.h).

Shapes: N samples, l <= L levels.
"""

from functools import cache
from pathlib import Path

import numpy as np
import warp as wp

from ...base.native import LANES_H, MOST_LANES, native_source
from ...definition.networks import GEOMETRY_FEATURES, MAX_LOG_SIGMA, sigma_from, sigmoid
from .basis import BASIS_COUNT
from .shapes import Layers

NETWORK_BLOCK = 48  # samples that pass the layers together: whole ROWS of layers.h, whole vectors
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
    pairs: wp.array(dtype=int)  # weights [⌈in / 2⌉, width] of each layer, `row_pairs`
    shapes: wp.array(dtype=int)  # of each layer: in, width, where weights, bias and pairs begin
    density_count: int  # layers
    color_count: int
    widest: int  # of all layers


def native_networks(density_layers: Layers, color_layers: Layers) -> NativeNetworks:
    """Copy the layers to where native code finds them, also as pairs of bfloat16."""
    values, pairs, shapes, start, pair_start = [], [], [], 0, 0
    for weights, bias in (*density_layers, *color_layers):
        missing = -len(bias) % MOST_LANES
        weights = np.pad(weights, ((0, 0), (0, missing)))
        bias = np.pad(bias, (0, missing))
        shapes.append((*weights.shape, start, start + weights.size, pair_start))
        values += [weights.ravel(), bias]
        pairs.append(row_pairs(weights).ravel())
        start += weights.size + bias.size
        pair_start += pairs[-1].size
    networks = NativeNetworks()
    networks.values = wp.array(np.concatenate(values), dtype=float, device="cpu")
    networks.pairs = wp.array(np.concatenate(pairs), dtype=int, device="cpu")
    networks.shapes = wp.array(np.ravel(shapes).astype(np.int32), dtype=int, device="cpu")
    networks.density_count, networks.color_count = len(density_layers), len(color_layers)
    networks.widest = max(width for _, width, *_ in shapes)
    return networks


def row_pairs(weights):
    """Rows 2k and 2k + 1 as bfloat16 in one word, row 2k in its low half.

    [in, width] -> [⌈in / 2⌉, width] int32.  Beside a last row without another are zeros.
    """
    halves = bfloat16(np.pad(weights, ((0, len(weights) % 2), (0, 0)))).view(np.uint32)
    return (halves[::2] >> 16 | halves[1::2]).view(np.int32)


def bfloat16(x):
    """Numbers rounded to the nearest bfloat16, which is a float32 without its lower half."""
    bits = np.ascontiguousarray(x, np.float32).view(np.uint32)
    even = bits >> 16 & 1  # of two that are as near, the even one
    return (bits + (0x7FFF + even) & 0xFFFF0000).astype(np.uint32).view(np.float32)


@wp.func_native(
    native_source(Path(__file__).parent / "cpu.cpp", [LAYERS_H, LANES_H], NATIVE_VALUES)
)
def apply_native(
    networks: NativeNetworks,
    first_layer: int,
    layer_count: int,
    in_pairs: int,
    x: wp.array2d(dtype=float),
    scratch: wp.array(dtype=float),
    y: wp.array2d(dtype=float),
): ...


@wp.kernel(enable_backward=False)
def apply_kernel(
    networks: NativeNetworks,
    first_layer: int,
    layer_count: int,
    in_pairs: int,  # 1: multiply pairs of bfloat16, where the processor can
    x: wp.array2d(dtype=float),  # [N, in], an even number of columns
    scratch: wp.array(dtype=float),
    y: wp.array2d(dtype=float),  # [N, out] out
):
    """`mlp` of core/definition for all rows, by one thread."""
    apply_native(networks, first_layer, layer_count, in_pairs, x, scratch, y)


@wp.func_native("""
#if defined(__AVX512BF16__)  // as in layers.h
answer.data[0] = 1;
#endif
""")
def answer_native(answer: wp.array(dtype=int)): ...


@wp.kernel(enable_backward=False)
def answer_kernel(answer: wp.array(dtype=int)):  # [1] out
    answer_native(answer)


@cache
def multiplies_pairs() -> bool:
    """Whether this processor multiplies pairs of bfloat16, so that `half` makes a difference."""
    answer = wp.zeros(1, dtype=int, device="cpu")
    wp.launch(answer_kernel, 1, [], [answer], device="cpu")
    return bool(answer.numpy()[0])


class CpuNetworks:
    """Both networks for arrays in the CPU's memory, in float32.

    With `half`, numbers and weights are rounded to bfloat16 where the processor multiplies pairs
    of them (layers.h).
    """

    def __init__(self, density_layers: Layers, color_layers: Layers):
        self._networks = native_networks(density_layers, color_layers)

    def geometry(self, features, half=False):
        """sigma [N] and h [N, 16] from features [N, l] vec4, Warp arrays."""
        rows = features.numpy().reshape(len(features), 4 * features.shape[1])
        h = self._apply((0, self._networks.density_count), half, rows, GEOMETRY_FEATURES)
        return wp.array(sigma_from(h), dtype=float, device="cpu"), wp.array(h, device="cpu")

    def colors(self, h, basis, half=False):
        """rgb [N] from h [N, 16] and Y(d) [N], Warp arrays."""
        joined = np.concatenate([h.numpy(), basis.numpy()], axis=1)
        layers = self._networks.density_count, self._networks.color_count
        rgb = sigmoid(self._apply(layers, half, joined, 3))
        return wp.array(rgb, dtype=wp.vec3, device="cpu")

    def _apply(self, layers, half, rows, width):
        y = np.empty((len(rows), width), np.float32)
        size = NETWORK_BLOCK * 2 * (self._networks.widest + rows.shape[1])
        scratch = wp.empty(size, dtype=float, device="cpu")
        x, out = (wp.array(a, dtype=float, device="cpu", copy=False) for a in (rows, y))
        inputs = [self._networks, *layers, int(half), x, scratch]
        if len(rows):
            wp.launch(apply_kernel, 1, inputs, [out], device="cpu")
        return y
