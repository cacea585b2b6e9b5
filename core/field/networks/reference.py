"""The two small MLPs and the view direction's basis, in NumPy.

    h = density_mlp(features)          [N, 16]
    sigma = exp(h[:, 0])               per unit of rest length
    rgb = sigmoid(color_mlp([h, Y(d)]))

Y is the real spherical-harmonics basis of degree 0..3 in the sample's direction d
(Ramamoorthi & Hanrahan 2001; as Instant-NGP).  Everything here works in the precision of
what it is given: in float64 it is the reference, in float32 the renderer on the CPU.

A network is a tuple of layers (weights [in, out], bias [out]); hidden layers have the
activation that the field's options name, the last one none.
"""

import numpy as np
import warp as wp

GEOMETRY_FEATURES = 16  # h; its first column is the logarithm of sigma
BASIS_COUNT = 16  # spherical harmonics of degree < 4
CONSTANT_BASIS = (0.28209479177387814, *[0.0] * (BASIS_COUNT - 1))  # no direction in it
BLOCK = 512  # samples; 128 KB for 64 channels
MAX_LOG_SIGMA = 15.0  # exp stays far from float32's and float16's limits; 3e6 is opaque


def relu(x):
    return np.maximum(x, 0, out=x)


def sigmoid(x):
    """1 / (1 + exp(-x)), in place and without overflow."""
    np.multiply(x, 0.5, out=x)
    np.tanh(x, out=x)
    x += 1
    return np.multiply(x, 0.5, out=x)


ACTIVATIONS = {"relu": relu, "sigmoid": sigmoid}


def mlp(x, layers, activation: str):
    """Apply a network.  [N, in] -> [N, out]"""
    act = ACTIVATIONS[activation]
    for weights, bias in layers[:-1]:
        x = x @ weights
        x += bias
        x = act(x)
    weights, bias = layers[-1]
    x = x @ weights
    x += bias
    return x


def sigma_from(h):
    """Density per unit of rest length from the density network's output.  [N]"""
    return np.exp(np.minimum(h[:, 0], MAX_LOG_SIGMA))


def spherical_harmonics(directions):
    """The 16 real spherical harmonics of degree 0..3 of unit vectors.  [N, 3] -> [N, 16]"""
    x, y, z = directions[:, 0], directions[:, 1], directions[:, 2]
    xx, yy, zz = x * x, y * y, z * z
    return np.stack(
        [
            np.full_like(x, 0.28209479177387814),
            -0.4886025119029199 * y,
            0.4886025119029199 * z,
            -0.4886025119029199 * x,
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (3.0 * zz - 1.0),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
            -0.5900435899266435 * y * (3.0 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (5.0 * zz - 1.0),
            0.3731763325901154 * z * (5.0 * zz - 3.0),
            -0.4570457994644658 * x * (5.0 * zz - 1.0),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3.0 * yy),
        ],
        axis=-1,
    )


basis_vector = wp.types.vector(length=BASIS_COUNT, dtype=wp.float32)


@wp.func
def basis_of(d: wp.vec3):
    """spherical_harmonics for one direction."""
    x = d[0]
    y = d[1]
    z = d[2]
    xx = x * x
    yy = y * y
    zz = z * z
    return basis_vector(
        0.28209479177387814,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (3.0 * zz - 1.0),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3.0 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (5.0 * zz - 1.0),
        0.3731763325901154 * z * (5.0 * zz - 3.0),
        -0.4570457994644658 * x * (5.0 * zz - 1.0),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3.0 * yy),
    )


def evaluate(features, basis, density_layers, color_layers, options):
    """Density and color of samples.

    Args:
        features: Encoding.  [N, L·F]
        basis: spherical_harmonics of the samples' directions.  [N, 16]
        options: FieldOptions; names the activations.

    Returns:
        sigma [N] and rgb [N, 3].
    """
    h = mlp(features, density_layers, options.density_activation)
    rgb = sigmoid(mlp(np.concatenate([h, basis], axis=1), color_layers, "relu"))
    return sigma_from(h), rgb


class BlockedNetworks:
    """`evaluate` in float32, in blocks of samples whose activations stay in a core's cache.

    A pass over a block costs as much as a small layer, so there are few.  relu(x + b) is
    max(x, -b) + b, and adding b is left to the next layer's bias; the first color layer reads
    h and the basis from one buffer, which the last density layer writes to.  Biases are as
    large as a block, because NumPy is 2 to 4 times slower with a row or a scalar.
    """

    def __init__(self, density_layers, color_layers, options):
        missing = np.zeros(len(density_layers[0][0]), np.float32)
        self._density = _HiddenLayers(density_layers[:-1], options.density_activation, missing)
        self._h_weights, bias = density_layers[-1]
        missing = bias + self._density.missing @ self._h_weights
        self._log_sigma_bias = missing[0]
        missing = np.append(missing, np.zeros(BASIS_COUNT, np.float32))
        self._color = _HiddenLayers(color_layers[:-1], "relu", missing)
        self._rgb_weights, bias = color_layers[-1]
        self._rgb_bias = np.tile(bias + self._color.missing @ self._rgb_weights, (BLOCK, 1))

    def evaluate(self, features, basis):
        """Density and color of samples.

        Args:
            features: Of all levels, or of the coarser ones.  [N, l·F]
            basis: [N, 16]

        Returns:
            sigma [N] and rgb [N, 3].
        """
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
    """Layers with an activation, as BlockedNetworks has them.

    Attributes:
        missing: What has to be added to the output, [width]; here the input lacks as much.
    """

    def __init__(self, layers, activation, missing):
        self._activation = activation
        self._layers = []
        self.missing = missing
        for weights, bias in layers:
            bias = bias + self.missing @ weights
            is_relu = activation == "relu"
            self._layers.append((weights, np.tile(-bias if is_relu else bias, (BLOCK, 1))))
            self.missing = bias if is_relu else np.zeros_like(bias)

    def buffers(self):
        """One for each layer's output in a block."""
        return [np.empty_like(bias) for _, bias in self._layers]

    def apply(self, x, buffers):
        """[n, in] -> [n, width], one of the buffers.  Missing inputs are taken to be zero."""
        count = len(x)
        for (weights, bias), y in zip(self._layers, buffers, strict=True):
            x = np.matmul(x, weights[: x.shape[1]], out=y[:count])
            if self._activation == "relu":
                np.maximum(x, bias[:count], out=x)
            else:
                x += bias[:count]
                ACTIVATIONS[self._activation](x)
        return x
