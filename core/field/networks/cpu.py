"""The networks in NumPy and float32, in blocks: for rendering on the CPU.

A block's activations stay in a core's cache, and its passes are few, as each costs as much
as a small layer.  relu(x + b) is max(x, -b) + b, and the next layer's bias adds that b; the
first color layer reads h and the basis from one buffer, which the last density layer writes
to.  Biases are as large as a block, because NumPy is 2 to 4 times slower with a row.

Shapes: N samples, l <= L levels, F features per level.
"""

import numpy as np

from .reference import BASIS_COUNT, GEOMETRY_FEATURES, MAX_LOG_SIGMA, Layers, sigmoid

BLOCK = 512  # samples; 128 KB for 64 channels


class CpuNetworks:
    """Both networks of a field; `reference.evaluate` up to rounding."""

    def __init__(self, density_layers: Layers, color_layers: Layers):
        missing = np.zeros(len(density_layers[0][0]), np.float32)
        self._density = _HiddenLayers(density_layers[:-1], missing)
        self._h_weights, bias = density_layers[-1]
        missing = bias + self._density.missing @ self._h_weights
        self._log_sigma_bias = missing[0]
        missing = np.append(missing, np.zeros(BASIS_COUNT, np.float32))
        self._color = _HiddenLayers(color_layers[:-1], missing)
        self._rgb_weights, bias = color_layers[-1]
        self._rgb_bias = np.tile(bias + self._color.missing @ self._rgb_weights, (BLOCK, 1))

    def evaluate(self, features, basis):
        """sigma [N] and rgb [N, 3] of samples, from features [N, l·F] and Y(d) [N, 16]."""
        count = len(features)
        sigma, rgb = np.empty(count, np.float32), np.empty((count, 3), np.float32)
        joined = np.empty((BLOCK, GEOMETRY_FEATURES + BASIS_COUNT), np.float32)
        density_buffers, color_buffers = self._density.buffers(), self._color.buffers()
        for start in range(0, count, BLOCK):
            part = slice(start, start + BLOCK)
            color = rgb[part]
            x = self._density.apply(features[part], density_buffers)
            y = joined[: len(x)]
            np.matmul(x, self._h_weights[: x.shape[1]], out=y[:, :GEOMETRY_FEATURES])
            np.add(y[:, 0], self._log_sigma_bias, out=sigma[part])
            y[:, GEOMETRY_FEATURES:] = basis[part]
            x = self._color.apply(y, color_buffers)
            np.matmul(x, self._rgb_weights, out=color)
            color += self._rgb_bias[: len(x)]
            sigmoid(color)
        np.minimum(sigma, MAX_LOG_SIGMA, out=sigma)
        return np.exp(sigma, out=sigma), rgb


class _HiddenLayers:
    """Layers with ReLU, each without the addition of its bias.

    Attributes:
        missing: The bias that `apply` leaves out; the next layer's bias includes it.  [width]
    """

    def __init__(self, layers: Layers, missing):
        """`missing` is the bias that the input lacks.  [in]"""
        self._layers = []
        self.missing = missing
        for weights, bias in layers:
            self.missing = bias + self.missing @ weights
            self._layers.append((weights, np.tile(-self.missing, (BLOCK, 1))))

    def buffers(self):
        """One for each layer's output in a block."""
        return [np.empty_like(bias) for _, bias in self._layers]

    def apply(self, x, buffers):
        """[n, in] -> [n, width], one of the buffers.  Missing inputs are taken to be zero."""
        for (weights, bias), y in zip(self._layers, buffers, strict=True):
            x = np.matmul(x, weights[: x.shape[1]], out=y[: len(x)])
            np.maximum(x, bias[: len(x)], out=x)
        return x
