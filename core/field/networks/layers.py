"""The weights of both networks as layers.h reads them: in floats, and in pairs of bfloat16."""

from functools import cache
from pathlib import Path

import numpy as np
import warp as wp

from ...base.native import MOST_LANES
from ...definition.networks import GEOMETRY_FEATURES, MAX_LOG_SIGMA
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
